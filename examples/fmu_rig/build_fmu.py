"""Compile two_post.c into an FMU: `python build_fmu.py two_post.fmu`, `--fmi 3` for FMI 3.0; needs a C compiler."""

import argparse
import re
import subprocess
import tempfile
import zipfile
from pathlib import Path

import fmpy

SOURCE = Path(__file__).with_name("two_post.c")
HEADERS = Path(fmpy.__file__).with_name("c-code")
NAME = "two_post"
# In the order of their value references: name, causality, variability, unit, start.
VARIABLES = (
    ("front.stroke", "input", "continuous", "m", "0"),
    ("rear.stroke", "input", "continuous", "m", "0"),
    ("front.force", "output", "continuous", "N", None),
    ("rear.force", "output", "continuous", "N", None),
    ("stiffness", "parameter", "fixed", "N/m", "4e5"),
    ("fault", "parameter", "fixed", None, "0"),
    ("fault_above", "parameter", "fixed", "m", "0"),
    ("time", "independent", "continuous", "s", None),
)
UNITS = {"m": 'm="1"', "N": 'kg="1" m="1" s="-2"', "N/m": 'kg="1" s="-2"', "s": 's="1"'}
OUTPUTS = [index for index, variable in enumerate(VARIABLES) if variable[1] == "output"]


def model_description(fmi: int) -> str:
    """Return modelDescription.xml for FMI 2.0 or 3.0."""
    units = "".join(f'<Unit name="{name}"><BaseUnit {exponents}/></Unit>' for name, exponents in UNITS.items())
    variables = []
    for reference, (name, causality, variability, unit, start) in enumerate(VARIABLES):
        common = f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}"'
        value = (f' unit="{unit}"' if unit else "") + (f' start="{start}"' if start else "")
        variables.append(
            f"<ScalarVariable {common}><Real{value}/></ScalarVariable>" if fmi == 2 else f"<Float64 {common}{value}/>"
        )
    if fmi == 2:
        head = 'fmiVersion="2.0" guid="two_post"'
        structure = "".join(f'<Unknown index="{index + 1}"/>' for index in OUTPUTS)
        outputs, initial = f"<Outputs>{structure}</Outputs>", f"<InitialUnknowns>{structure}</InitialUnknowns>"
    else:
        head = 'fmiVersion="3.0" instantiationToken="two_post"'
        outputs = "".join(f'<Output valueReference="{index}"/>' for index in OUTPUTS)
        initial = outputs.replace("Output", "InitialUnknown")
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription {head} modelName="{NAME}">'
        f'<CoSimulation modelIdentifier="{NAME}" canHandleVariableCommunicationStepSize="true"/>'
        f"<UnitDefinitions>{units}</UnitDefinitions><ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure>{outputs}{initial}</ModelStructure></fmiModelDescription>"
    )


def compile_library(folder: Path) -> Path:
    """Compile the source into a library that exports every function of both standards, also unused ones."""
    own = set(re.findall(r"\b(fmi[23]\w+)\(", SOURCE.read_text(encoding="utf-8")))
    declared = "".join((HEADERS / f"fmi{fmi}Functions.h").read_text(encoding="utf-8") for fmi in (2, 3))
    others = set(re.findall(r"#define (fmi[23][A-Z]\w+)\s", declared)) - own - {"fmi2Version", "fmi3Version"}
    stubs = folder / "stubs.c"
    stubs.write_text("".join(f"int {name}(void) {{ return 3; }}\n" for name in sorted(others)), encoding="utf-8")
    library = folder / f"{NAME}{fmpy.sharedLibraryExtension}"
    command = [
        "cc",
        "-O2",
        "-shared",
        "-fPIC",
        "-ffp-contract=off",
        f"-I{HEADERS}",
        "-o",
        library,
        SOURCE,
        stubs,
        "-lm",
    ]
    subprocess.run(command, check=True)
    return library


def build(path: Path, *, fmi: int = 2) -> Path:
    """Write the FMU and return its path."""
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(path, "w") as archive:
        platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
        archive.writestr("modelDescription.xml", model_description(fmi))
        archive.write(library := compile_library(Path(folder)), f"binaries/{platform}/{library.name}")
    return path


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path)
    parser.add_argument("--fmi", type=int, choices=(2, 3), default=2)
    arguments = parser.parse_args()
    build(arguments.path, fmi=arguments.fmi)
