"""The bus beside bare Zenoh."""
