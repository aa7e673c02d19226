"""The engine under studies, maps and searches: cells, their store, and threads or a cluster that
compute them."""
