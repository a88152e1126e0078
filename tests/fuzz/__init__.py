"""Generated requests against a running system, as each role: no 5xx, nothing undocumented, nothing beyond the role."""
