"""PFSMs in words: what modules do, what a PFSM does, and how two of them differ."""
