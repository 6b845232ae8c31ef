"""Physical parameters of a flexible beam from an accelerometer record.

    import beamid

    fit = beamid.fit(t, a, beam=dict(length=4, rho=.03, E=80, I=1, c_D=.005), tip=dict(m_T=.15),
                     excitation=dict(kind="pulse", amplitude=1, duration=.05), free=["E", "c_D"])
    print(fit)                                   # the verdict, then estimates and intervals
    fit["E"].value, fit["E"].interval, fit.warnings
    beamid.profile(fit).plot()                   # also sample and bootstrap
    beamid.modes(fit, beam=dict(length=3.9))     # also simulate, frf and design

`help(beamid.fit)` describes all arguments. The groups and keys are those of a case file, and
`beamid.load("case.nml")` takes a case file as it is. Arguments beside a case, a problem or a fit
change its keys. Errors carry the messages of the program. Lengths, masses and times are in any
consistent units; `units=dict(length="m", mass="kg", time="s", force="N")` names them and enables
the checks of units. Residuals are always record - model.
"""
from ._cases import FrequencyRecord, ModalRecord, Record
from ._commands import (ComparedModel, Comparison, DampingRatio, Design, Ensemble,
                        FrequencyResponse, MemberStatistics, Modes, NestedPair, Results, Simulation,
                        compare, design, ensemble, frf, modes, simulate)
from ._fits import Estimate, Fit, FittedMode, FittedResponse, Mode, Problem, fit, load
from ._inference import (Bootstrap, Inference, Interval, Posterior, Profile, Profiles, bootstrap,
                         profile, sample)
from ._library import BeamidError, ComputationError, InputError, NoFit
from ._responses import Response, response
from ._tracking import TrackedWindow, Tracker

__all__ = ["BeamidError", "Bootstrap", "ComparedModel", "Comparison", "ComputationError",
           "DampingRatio", "Design", "Ensemble", "Estimate", "Fit", "FittedMode", "FittedResponse",
           "FrequencyRecord", "FrequencyResponse", "Inference", "InputError", "Interval",
           "MemberStatistics", "ModalRecord", "Mode", "Modes", "NestedPair", "NoFit", "Posterior",
           "Problem", "Profile", "Profiles", "Record", "Response", "Results", "Simulation",
           "TrackedWindow", "Tracker", "bootstrap", "compare", "design", "ensemble", "fit", "frf",
           "load", "modes", "profile", "response", "sample", "simulate"]
__version__ = "0.2.0"
