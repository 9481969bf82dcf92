"""Coverage of faces and of the surface: task, criteria, decision, networks, the evaluation."""
