"""What decoder and simulator both know: films, fields, stencils, elastic laws."""
