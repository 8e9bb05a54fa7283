"""Report on a study: one page that compares episodes by a label."""
