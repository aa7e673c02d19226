"""An engineer's answer: does it rattle, how hard, what helps, can a closure be used."""
