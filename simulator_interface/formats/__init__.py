"""File formats of other systems; each module reads or writes one of them."""
