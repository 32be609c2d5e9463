"""Measurements of speed and accuracy: the cases of `pdjax bench`, their common parts, and `advise`.

A case is one small file with a plan of its measurements, row by row, and a function that draws them. The table
`cases.CASES` lists the cases. `advise` reads the measured rows. It is the only part that the rest of the package
imports, and it needs neither the cases nor matplotlib. The modules, in the order in which to read them:

    advice         advise: the fastest method and setting that meet a tolerance
    harness        timing, counts of the compiler, the machine, result files
    cases          the table of cases
    ways           case: the force density by every backend
    jacobians      case: the Jacobian of a body by five methods
    statics        case: the singular bar by every solver
    integrators    case: a travelling wave by every integrator
    criteria       case: the critical load by every criterion
    precision      case: float32 compared with float64
    device         case: memory bandwidth and arithmetic rate of the device
    start          case: the time until the first result
    first_calls    the time and the compiled programs of the first call of each function
    chart          the chart of error against time
"""
