"""The paper's testable claims, each with its test, its evidence and a verdict."""
