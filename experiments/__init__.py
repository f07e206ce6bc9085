"""What measures the product; neither the product nor its tests import it."""
