"""What people see of a race: while it runs, and when it is done."""
