"""Electronics of a unit's board: capacitor and timer, counter, divider, Hall chip."""
