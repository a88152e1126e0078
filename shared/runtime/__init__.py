"""What every service's process has in common: settings, logging, lifecycle, bounded hand-over, watchdog."""
