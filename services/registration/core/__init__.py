"""Pure estimation and judgement: arrays and values in, frozen results out."""
