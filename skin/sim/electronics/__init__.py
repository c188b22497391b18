"""What a board makes of its unit: capacitor and timer, counter, divider, Hall chip."""
