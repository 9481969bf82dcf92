"""Exact visibility: half planes in the image, and the certificate that saves most of them."""
