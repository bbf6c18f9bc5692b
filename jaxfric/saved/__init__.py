"""Read and check the result files of all commands, and read the friction law of a result.

files           the JSON of a fit, a loop or a steady curve
upgrade         conversion of files of earlier versions to the current form
entry           "friction_law", the entry with the law in each of these files
posterior_file  a posterior, as netCDF
table           a table of steady-state friction against speed
law             the law of any such file, or of a result object
"""

from .law import law_from_fit as law_from_fit
from .table import law_from_table as law_from_table
