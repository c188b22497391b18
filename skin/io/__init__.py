"""Output and input of a skin: tables and data sets (`export`, `bulk`), and messages, as recordings
(`record`) and as topics (`publish`)."""
