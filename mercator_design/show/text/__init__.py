"""Reports for people: progress, summaries, tables and pictures."""
