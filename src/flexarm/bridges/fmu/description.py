"""``modelDescription.xml`` of FMI 2.0 and 3.0, and ``buildDescription.xml`` of FMI 3.0."""

from __future__ import annotations

from importlib.metadata import version
from xml.etree import ElementTree as XML

from flexarm.bridges.fmu.variables import Variable

#: Exponents of SI base units; modal coordinates have a fractional one, which FMI cannot express.
_UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s^2": {"rad": 1, "s": -2},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N m": {"kg": 1, "m": 2, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
}


def model_description(
    fmi: str, name: str, token: str, sources: list[str], variables: list[Variable], step: float
) -> bytes:
    """Return ``modelDescription.xml``.

    Args:
        fmi: "2.0" or "3.0".
        name: identifier of the model. token: its GUID or instantiation token.
        sources: names of the source files to compile.
        variables: by value reference.
        step: proposed communication step, s.
    """
    two = fmi == "2.0"
    root = XML.Element("fmiModelDescription", fmiVersion=fmi, modelName=name)
    root.set("guid" if two else "instantiationToken", token)
    root.set("description", "planar arm with flexible links")
    root.set("generationTool", f"flexarm {version('flexarm')}")
    root.set("variableNamingConvention", "flat")
    if two:
        root.set("numberOfEventIndicators", "0")
    _add_interfaces(root, two, name, sources)
    _add_units(root, variables)
    if two:
        categories = XML.SubElement(root, "LogCategories")
        XML.SubElement(categories, "Category", name="logStatusError")
    XML.SubElement(root, "DefaultExperiment", startTime="0", tolerance="1e-07", stepSize=repr(step))
    listed = XML.SubElement(root, "ModelVariables")
    for place, variable in enumerate(variables):
        (_add_variable_2 if two else _add_variable_3)(listed, place, variable)
    _add_structure(root, two, variables)
    return _bytes(root)


def build_description(name: str, sources: list[str]) -> bytes:
    """Return ``buildDescription.xml`` of FMI 3.0."""
    root = XML.Element("fmiBuildDescription", fmiVersion="3.0")
    build = XML.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    files = XML.SubElement(build, "SourceFileSet", language="C99")
    for source in sources:
        XML.SubElement(files, "SourceFile", name=source)
    XML.SubElement(build, "Library", name="m", external="true")
    return _bytes(root)


def _bytes(root: XML.Element) -> bytes:
    XML.indent(root)
    return bytes(XML.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _add_interfaces(root: XML.Element, two: bool, name: str, sources: list[str]) -> None:
    saves = ("canGetAndSetFMUstate", "canSerializeFMUstate")
    for kind in ("ModelExchange", "CoSimulation"):
        element = XML.SubElement(root, kind, modelIdentifier=name)
        for save in saves:
            element.set(save if two else save.replace("FMUstate", "FMUState"), "true")
        if kind == "CoSimulation":
            element.set("canHandleVariableCommunicationStepSize", "true")
        elif two:
            element.set("completedIntegratorStepNotNeeded", "true")
        if two:
            element.set("canNotUseMemoryManagementFunctions", "true")
            files = XML.SubElement(element, "SourceFiles")
            for source in sources:
                XML.SubElement(files, "File", name=source)


def _add_units(root: XML.Element, variables: list[Variable]) -> None:
    units = XML.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(variable.unit for variable in variables if variable.unit):
        unit = XML.SubElement(units, "Unit", name=name)
        if name in _UNITS:
            exponents = {key: str(power) for key, power in _UNITS[name].items()}
            XML.SubElement(unit, "BaseUnit", exponents)


def _initial(variable: Variable) -> str:
    """Return the attribute ``initial``; inputs and time have none."""
    if variable.causality in ("input", "independent"):
        return ""
    return "calculated" if variable.start is None else "exact"


def _attributes(place: int, variable: Variable) -> dict[str, str]:
    found = {"name": variable.name, "valueReference": str(place)}
    found |= {"description": variable.description, "causality": variable.causality}
    found["variability"] = variable.variability
    if _initial(variable):
        found["initial"] = _initial(variable)
    return found


def _numbers(variable: Variable, first: int) -> dict[str, str]:
    """Return the attributes of a number; states are counted from ``first``."""
    found = {"unit": variable.unit} if variable.unit else {}
    if variable.start is not None:
        found["start"] = repr(variable.start)
    if variable.nominal is not None:
        found["nominal"] = repr(variable.nominal)
    if variable.state is not None:
        found["derivative"] = str(variable.state + first)
    return found


def _add_variable_2(parent: XML.Element, place: int, variable: Variable) -> None:
    scalar = XML.SubElement(parent, "ScalarVariable", _attributes(place, variable))
    XML.SubElement(scalar, "Real", _numbers(variable, 1))


def _add_variable_3(parent: XML.Element, place: int, variable: Variable) -> None:
    XML.SubElement(parent, "Float64", _attributes(place, variable) | _numbers(variable, 0))


def _add_structure(root: XML.Element, two: bool, variables: list[Variable]) -> None:
    structure = XML.SubElement(root, "ModelStructure")
    numbered = list(enumerate(variables))
    outputs = [k for k, one in numbered if one.causality == "output"]
    derivatives = [k for k, one in numbered if one.state is not None]
    unknown = [
        k
        for k, one in numbered
        if _initial(one) == "calculated" and (one.causality == "output" or one.state is not None)
    ]
    groups = {"Outputs": outputs, "Derivatives": derivatives, "InitialUnknowns": unknown}
    names = {"Outputs": "Output", "Derivatives": "ContinuousStateDerivative"}
    for group, places in groups.items():
        if two:
            parent = XML.SubElement(structure, group) if places else structure
            for place in places:
                XML.SubElement(parent, "Unknown", index=str(place + 1))
        else:
            for place in places:
                name = names.get(group, "InitialUnknown")
                XML.SubElement(structure, name, valueReference=str(place))
