"""The names of the schemas of all result files, "jaxfric.KIND/VERSION", in one place.

The version number of a schema grows if a key changes its name or its meaning. `saved.upgrade` reads
files of earlier versions.
"""

COMPARISON = "jaxfric.comparison/1"
FEEDFORWARD = "jaxfric.feedforward/2"
FIT = "jaxfric.fit/2"
FITS = "jaxfric.fits/1"
FOLDER = "jaxfric.folder/1"
GAINS = "jaxfric.gains/2"
LOOP = "jaxfric.loop/2"
POSTERIOR = "jaxfric.posterior/1"
PREDICTION = "jaxfric.prediction/1"
PROTOCOL = "jaxfric.protocol/1"
RECORD = "jaxfric.record/1"
RUN = "jaxfric.run/1"
SIMULATION = "jaxfric.simulation/2"
STABILITY = "jaxfric.stability/2"
STEADY = "jaxfric.steady/2"
STUDY = "jaxfric.study/2"
"""Of the store of a study; the command prints a `STUDY_SUMMARY` of the store."""
STUDY_SUMMARY = "jaxfric.study_summary/1"

VERBS = {
    FIT: "jaxfric fit",
    LOOP: "jaxfric loop",
    STEADY: "jaxfric axis",
    POSTERIOR: "jaxfric fit and a file of priors",
}
"""The command that makes a file that others read."""
