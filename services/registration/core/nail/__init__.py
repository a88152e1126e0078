"""The nail: coarse search, maximum likelihood on the pixels, covariance."""
