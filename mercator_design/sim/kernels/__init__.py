"""Compiled code of one experiment: motion, contacts, sensing, control; and the numbers that it works on."""
