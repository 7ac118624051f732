"""One race: configurations on instance after instance, until statistical tests have eliminated the worse ones."""
