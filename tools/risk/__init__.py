"""The risk file in `docs/risk`: read, printed as pages, and compared with the tests that ran."""
