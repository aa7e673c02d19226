"""What the installed program must obey: published results, extreme values, stability."""
