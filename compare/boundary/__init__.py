"""Where exactly a closure stops holding, along a parameter of the scene."""
