"""Stories of `skin demo …` on the simulator: grips, gestures, people, vessels and flames."""
