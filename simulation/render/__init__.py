"""X-ray images of the virtual operating room by analytic ray tracing. Shares no code with the estimators."""
