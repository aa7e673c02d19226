"""What a parameter of the scene does: where a closure stops holding, and which lever changes the
rattle."""
