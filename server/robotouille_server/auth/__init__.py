"""Who somebody is and what they may do: visitors, roles, tokens and the keys that sign them."""
