"""The local page of `beamid studio`: from a recorder's file to a report.

The page runs in the browser, and this package serves it to one user of this machine. It adds no
numerics: the readers of `beamid to-csv` read files, the program and the package `beamid` compute,
and the components of `beamid report` draw. Every fit is an ordinary case file with its outputs.
"""
