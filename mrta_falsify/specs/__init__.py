"""Specifications: folds over frames that say how safe a run was, and who is to blame."""
