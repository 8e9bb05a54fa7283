"""What the data is written as: tables, chat, arrays and Minari's data sets."""
