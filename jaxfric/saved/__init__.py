"""Results in files: read and checked, whatever verb wrote them; the friction law of any.

files           the JSON of a fit, a loop or a steady curve
upgrade         files of earlier versions, read as those of today
entry           "friction_law", the entry of all of them that a law is read from
posterior_file  a posterior, as netCDF
table           a table of steady friction against speed
law             the law of any such file, or of the result at hand
"""

from .law import law_from_fit as law_from_fit
from .table import law_from_table as law_from_table
