"""Tools of the other packages of pdjax, not meant for users. They contain no peridynamics.

The modules, in the order in which to read them:

    checks               checks of arguments, conversions between NumPy and JAX, safe writing of files
    public               error messages that name an argument of the wrong kind
    ending               enumerations of how a solver or a run ended
    shown                short text of models and results for print
    memory               results that are computed once for an object
    dependence           the constants of a model on which a result depends
    xla                  the settings of XLA that pdjax makes
    compilation_cache    compiled programs kept on disk
    implicit_step        derivatives of a root by the implicit function theorem
    threads              the cores that threads may use
    progress             the progress of a job on one line
    pictures             writing of figures to files
    json_values          values that JSON can hold
    moved                the new places of modules of earlier versions
    version              the version of pdjax
"""
