"""Contact of bodies and faces: shapes, elastic foundations, friction, viscoelasticity."""
