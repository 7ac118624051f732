"""What may be configured: parameters, their domains and conditions, and the expressions in them."""
