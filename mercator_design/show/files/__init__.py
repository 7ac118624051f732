"""Files for other programs: irace's scenarios and logs, tables and MCAP of robots' logs."""
