"""Errors of localisation, fusion, verification and guidance against known truth."""
