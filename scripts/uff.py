"""Reads the data sets 58 and 58b of universal files (UFF): functions of time, frequency response
functions and the coherences that belong to them. pyuff does the parsing."""

from channels import REMARKS, Channel, text_of
from program import fail
from responses import HERTZ, Response, quantity_of, quantity_of_unit, ratio_of_units

DIRECTIONS = ["", "+X", "+Y", "+Z", "+RX", "+RY", "+RZ", "-RZ", "-RY", "-RX", "-Z", "-Y", "-X"]
#: Function types, and specific data types of an axis.
UNKNOWN, TIME_RESPONSE, FREQUENCY_RESPONSE, COHERENCE = 0, 1, 4, 6
MEASURED = {8: "displacement", 11: "velocity", 12: "acceleration", 13: "force"}
TIME, FREQUENCY = 17, 18
#: Units of length and force by the code of a data set 164; 9 is user-defined.
SYSTEMS = {1: ("m", "N"), 2: ("ft", "lbf"), 3: ("m", "kgf"), 5: ("mm", "mN"), 6: ("cm", "cN"),
           7: ("in", "lbf"), 8: ("mm", "kgf"), 10: ("mm", "N")}
MOTIONS = {"displacement": "{}", "velocity": "{}/s", "acceleration": "{}/s^2"}
NODES = ("rsp_ent_name", "rsp_node", "rsp_dir", "ref_ent_name", "ref_node", "ref_dir")


def read_uff(path):
    """Returns the channels and FRFs of the data sets 58, and texts from other data sets."""
    import pyuff
    file, channels, responses, texts = pyuff.UFF(str(path)), [], [], []
    coherences, others, system = [], [], None
    for k, kind in enumerate(file.get_set_types()):
        if int(kind) not in (58, 164):
            continue
        data = file.read_sets(k)
        words = {key: text_of("" if value is None else value) for key, value in data.items()
                 if key not in ("x", "data")}
        if int(kind) == 164:
            texts += [f"set {k + 1}, units: " + ", ".join(f"{key} {words[key]}" for key in (
                "units_code", "units_description", "length", "force", "temp") if key in words)]
            system = SYSTEMS.get(data["units_code"])
            continue
        check_size(path, k + 1, data)
        of_time = data["abscissa_spec_data_type"] in (UNKNOWN, TIME)
        of_frequency = data["abscissa_spec_data_type"] in (UNKNOWN, FREQUENCY)
        if data["func_type"] in (UNKNOWN, TIME_RESPONSE) and of_time:
            channels.append(uff_channel(data, words))
        elif (data["func_type"] == FREQUENCY_RESPONSE and of_frequency
              and data["data"].dtype.kind == "c"):
            responses.append((k + 1, nodes_of(words), uff_response(data, words, system)))
        elif data["func_type"] == COHERENCE and of_frequency:
            coherences.append((k + 1, nodes_of(words), data))
        else:
            others.append(k + 1)
    others += attach(coherences, responses)
    remark(others, "is left out: it is neither a time series nor an FRF",
           "are left out: they are neither time series nor FRFs")
    unread = sorted({int(kind) for kind in file.get_set_types()} - {58, 164})
    if unread and not channels + responses:
        REMARKS.append(f"data sets of type {', '.join(map(str, unread))} contain neither")
    if channels:
        remark([number for number, *_ in responses], "is an FRF, written to a file of its own",
               "are FRFs, each written to a file of its own")
    return channels + [response for *_, response in responses], texts


def remark(numbers, one, several):
    """Says what happens to data sets that are not time series."""
    if numbers:
        listed = ", ".join(map(str, sorted(numbers)))
        REMARKS.append(f"set {listed} {one}" if len(numbers) == 1 else f"sets {listed} {several}")


def check_size(path, number, data):
    """Ends the script if a set is incomplete. Removes what pyuff found behind the last sample."""
    n = data["num_pts"]
    if len(data["data"]) < n:
        fail(f"{path}: set {number}: found {len(data['data'])} samples, expected {n} as it says")
    data["x"], data["data"] = data["x"][:n], data["data"][:n]


def words_of_set(words, data):
    """Returns the lines of text of a set, and the grid of its abscissa."""
    notes = [words[f"id{k}"] for k in range(1, 6) if words.get(f"id{k}") not in ("NONE", "", None)]
    if data["abscissa_spacing"] == 1:
        notes.append(f"from {words['abscissa_min']} by {words['abscissa_inc']}")
    return notes


def stated(words, key):
    """Returns a text of a set; empty if it is not used."""
    return words.get(key, "").replace("NONE", "")


def place_of(words, data, which):
    """Returns entity, node and direction of the response ('rsp') or of the reference ('ref')."""
    entity = stated(words, f"{which}_ent_name") or "node"
    return f"{entity} {data[f'{which}_node']}{DIRECTIONS[data[f'{which}_dir']]}"


def nodes_of(words):
    """Returns what identifies response and reference."""
    return tuple(stated(words, key) for key in NODES)


def uff_channel(data, words):
    """Returns a function of time."""
    return Channel(place_of(words, data, "rsp"), data["data"],
                   stated(words, "ordinate_axis_units_lab"), data["x"],
                   stated(words, "abscissa_axis_units_lab"), words_of_set(words, data),
                   MEASURED.get(data["ordinate_spec_data_type"], ""))


def unit_of(measured, system):
    """Returns the unit of a measured quantity in a system of units, or ''."""
    if system is None or not measured:
        return ""
    return system[1] if measured == "force" else MOTIONS[measured].format(system[0])


def uff_response(data, words, system):
    """Returns an FRF; its quantity follows from the types of its axes, or else from their units.

    system  units of length and force of the file, for axes without a unit; None: unknown
    """
    import numpy as np
    response, reference = (place_of(words, data, which) for which in ("rsp", "ref"))
    axes = ("ordinate", "orddenom")
    measured = [MEASURED.get(data.get(f"{axis}_spec_data_type"), "") for axis in axes]
    top, bottom = (stated(words, f"{axis}_axis_units_lab") or unit_of(one, system)
                   for axis, one in zip(axes, measured))
    # Some programs write the unit of the ratio as that of the numerator.
    unit = top if quantity_of_unit(top) else ratio_of_units(top, bottom)
    quantity = quantity_of(*measured) if all(measured) else quantity_of_unit(unit)
    label = stated(words, "abscissa_axis_units_lab")
    notes = [f"response {response}", f"reference {reference}", *words_of_set(words, data)]
    if label.lower() not in HERTZ:
        notes.append(f"frequencies are labelled '{label}', and taken as Hz")
    return Response(f"FRF {response}/{reference}",
                    np.asarray(data["x"], float) * HERTZ.get(label.lower(), 1.0), data["data"],
                    unit, quantity, notes=notes)


def attach(coherences, responses):
    """Gives each FRF the next coherence with the same nodes, directions and frequencies. Returns
    the numbers of the coherences that belong to no FRF."""
    import numpy as np
    left = []
    for number, nodes, data in coherences:
        label = stated({"unit": text_of(data.get("abscissa_axis_units_lab") or "")}, "unit")
        f = np.asarray(data["x"], float) * HERTZ.get(label.lower(), 1.0)
        own = next((response for _, others, response in responses
                    if others == nodes and response.coherence is None
                    and len(f) == len(response.frequencies)
                    and np.allclose(f, response.frequencies, rtol=1e-6, atol=1e-9)), None)
        if own is None:
            left.append(number)
        else:
            own.coherence = np.real(data["data"])
    return left
