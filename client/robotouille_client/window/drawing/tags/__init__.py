"""Names, speech, reasons and tips over the kitchen, and where they fit."""
