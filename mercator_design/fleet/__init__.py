"""Deploys control software to robots: the program as one file, and ssh to many robots."""
