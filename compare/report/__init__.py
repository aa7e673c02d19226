"""Reports: their pages, figures, tables and manifests, and the folders that hold them."""
