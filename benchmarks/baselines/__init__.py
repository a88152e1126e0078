"""The methods and libraries that the product is compared with."""
