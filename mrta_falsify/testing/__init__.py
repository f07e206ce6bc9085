"""What tests of layers, specifications and scenarios are made of; for authors of plug-ins, too.

- :mod:`~mrta_falsify.testing.wards` and :mod:`~mrta_falsify.testing.floors` build small worlds,
- :mod:`~mrta_falsify.testing.stacks` configures stacks for them,
- :mod:`~mrta_falsify.testing.watching` runs a world and reads off its trace what happened when,
- :mod:`~mrta_falsify.testing.planted` has a world for each planted fault, in which it shows.

Nothing of the product imports this package.
"""
