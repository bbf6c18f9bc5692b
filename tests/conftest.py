"""Fits and tight tolerances need 64-bit numbers; the package itself never sets this."""

import jax

jax.config.update("jax_enable_x64", True)
