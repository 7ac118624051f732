"""What people see of a study: verdicts, a page, tables and figures for a paper."""
