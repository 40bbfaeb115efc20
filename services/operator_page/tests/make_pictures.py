"""Write the pictures of the operator page: `python services/operator_page/tests/make_pictures.py`.

Each screen is taken four times: on a wide display and on a tablet, light and dark. A lab of the simulated front axle
runs a campaign in real time, and a linear rig runs an endurance test until its specimen cracks. `campaign`, `endurance`
or `viewer` as an argument takes a part; `viewer` is the rig in 3-D, which takes minutes without a graphics card.
"""

import argparse
import io
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import yaml

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
sys.path[:0] = [str(HERE), str(ROOT / "duralab" / "tests")]

from browser import Browser, browser_program  # noqa: E402
from page_in_browser import Page, decide  # noqa: E402
from page_lab import Client, PageLab, PageProcess, schedule  # noqa: E402
from PIL import Image  # noqa: E402
from scipy import signal  # noqa: E402

import duralab  # noqa: E402
from duralab import Signals  # noqa: E402
from duralab.formats import write_signals  # noqa: E402
from duralab.processes import Viewer  # noqa: E402

OUT = ROOT / "docs" / "pictures"
RIG = "front_axle_compliant"
NAME = "belgian_block_left"
LOOKS = {
    "": (1920, 1080, "light"),
    "_dark": (1920, 1080, "dark"),
    "_tablet": (820, 1180, "light"),
    "_tablet_dark": (820, 1180, "dark"),
}
LOGGER = {
    f"{side}_{axis}": f"F{letter}_F{side[0].upper()}"
    for side in ("left", "right")
    for axis, letter in (("vertical", "Z"), ("lateral", "Y"), ("longitudinal", "X"))
}
"""Channels of a data logger by response of the rig."""
EDIT = [{"resample": {"rate": 1000}}, {"shorten_by_damage": {"keep": 0.95}}, {"taper": {"seconds": 0.5}}]
LOGGER_RATE = 512.0


class Pictures:
    """A folder of pictures, each of a screen as it stands."""

    def __init__(self, page: Page, folder: Path) -> None:
        self._page, self._folder = page, folder

    def take(self, name: str, *, at: str = "scrollTo(0, 0)", looks: tuple[str, ...] = tuple(LOOKS)) -> None:
        """Take a screen in all looks; `at`: a script that brings the part that matters into view."""
        taken = {}
        for look in looks:
            self._page.look(*LOOKS[look])
            self._page.value("new Promise((done) => setTimeout(done, 500))")
            self._page.value(f"{at}; new Promise((done) => setTimeout(done, 300))")
            taken[look] = self._page.browser.picture()
        self._page.look(*LOOKS[""])
        # After all of them: a playback does not wait.
        for look, content in taken.items():
            image = Image.open(io.BytesIO(content)).convert("RGB")
            # Few colours: the file is small, and text stays sharp.
            image = image.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).convert("RGB")
            image.save(self._folder / f"operator_page_{name}{look}.webp", lossless=True, quality=100, method=4)


def below_header(selector: str) -> str:
    """Return a script that scrolls an element to just below the page's header."""
    return (
        f"document.querySelector({selector!r}).scrollIntoView();"
        "scrollBy(0, -8 - document.querySelector('header').offsetHeight)"
    )


def campaign() -> dict:
    """Return the demo on the compliant rig, a few seconds of it, held before each playback."""
    shipped = Path(duralab.__file__).with_name("campaign") / "shipped" / "front_axle_demo.yaml"
    document = yaml.safe_load(shipped.read_text())
    document |= {"name": NAME, "rig": RIG, "hold": "each", "real_time": True}
    # One experiment, so that the pictures take minutes less.
    del document["excitation"]["at_target"]
    rms = [0.004, 0.003, 0.001] * 2
    document["excitation"] |= {"rms": dict(zip(document["excitation"]["rms"], rms, strict=True)), "duration": 40.0}
    document["target"]["road"] |= {
        "duration": 24.0,
        "potholes": {"count": 1, "depth": [0.02, 0.03], "length": [0.4, 0.8]},
    }
    document["update"], document["stop"]["iterations"] = {"kind": "basic_twr", "iteration_gain": 0.7}, 9
    return document


def take_endurance(out: Path) -> None:
    """Run an endurance test until its specimen cracks, and sign in at a page with accounts."""
    with tempfile.TemporaryDirectory() as temporary, PageLab(Path(temporary)) as lab:
        served = lab.page("page")
        lab.put_schedule(served, schedule("weeks", keep={"first": 3, "every": 100, "around_alarm": 2}))
        with Browser(browser_program(), Path(temporary) / "profile") as browser:
            page = Page(browser, served.address)
            pictures = Pictures(page, out)
            page.go("endurance")
            page.choose("select[name=schedule]", "weeks")
            page.wait_for_text("1800 repeats on linear")
            pictures.take("endurance_begin")
            assert Client(served.address).act("/api/endurance", {"name": "weeks"})[0] == 200
            page.wait("Number(document.querySelector('.activity strong')?.innerText) > 60", 300.0)
            pictures.take("endurance")
            lab.rig.cracked = True
            page.wait("document.querySelector('.hold')", 300.0)
            page.wait("document.querySelector('.level')", 300.0)
            page.write(".hold input[name=reason]", "crack at the left bracket, seen from 40 cm")
            pictures.take("endurance_hold")
        with Browser(browser_program(), Path(temporary) / "people") as browser:
            page = Page(browser, lab.secured_page("people").address)
            page.wait("document.querySelector('input[type=password]')")
            page.write("input[autocomplete=username]", "Ada")
            Pictures(page, out).take("sign_in")


def take_campaign(out: Path) -> None:
    """Set a test up from a measured file, run it by hand, and read its report."""
    with tempfile.TemporaryDirectory() as temporary, duralab.start(temporary, rigs=(RIG, "predecessor")) as lab:
        folder = Path(temporary)
        served = PageProcess(lab.endpoints[0], folder / "page")
        try:
            (served.files / f"{NAME}.yaml").write_text(yaml.safe_dump(campaign()))
            with Browser(browser_program(), folder / "profile") as browser:
                page = Page(browser, served.address)
                pictures = Pictures(page, out)
                run(lab, page, pictures)
                set_up(lab, page, pictures, folder)
                read(page, pictures)
        finally:
            served.close()


def run(lab: duralab.Lab, page: Page, pictures: Pictures) -> None:
    """Take the screens of a campaign, from its start to the stop, and of the rig afterwards."""
    page.go("run")
    page.choose("select[name=campaign]", f"file:{NAME}")
    for look in LOOKS:
        page.wait("!document.querySelector('.go')", 12.0)
        page.click("section[aria-label='Begin a campaign'] .arm")
        page.wait("document.querySelector('.go')")
        pictures.take("armed", looks=(look,))
    page.click("section[aria-label='Begin a campaign'] .go")
    decide(page, 1)
    page.deliberate(".hold")
    decide(page, 2, reason="as predicted")
    page.wait("document.querySelectorAll('.hold canvas').length === 12")
    pictures.take("hold")
    pictures.take("hold_curves", at=below_header(".hold details"))
    page.deliberate(".hold")
    for number, look in enumerate(LOOKS, start=3):
        page.look(*LOOKS[look])
        page.wait_for_text("playing", "h1 .mode")
        page.value("new Promise((done) => setTimeout(done, 8000))")
        pictures.take("run", looks=(look,))
        decide(page, number)
        page.deliberate(".hold")
    page.wait_for_text("playing", "h1 .mode")
    page.go("lab")
    pictures.take("lab")
    page.click("#stop")
    page.go("rig")
    page.wait_for_text("interlocked", ".large")
    page.write("input[name=reset-reason]", "looked at the rig, nothing is loose")
    pictures.take("rig")
    lab.reset(RIG)
    # A second recording, to compare with.
    page.go("run")
    page.deliberate(".resume")
    page.wait_for_text(f"Run {NAME}-2", "h1")
    decide(page, 1)
    page.deliberate(".hold")
    decide(page, 2, "end", reason="good enough")
    page.deliberate(".hold")
    page.wait("document.querySelector('.resume')")


def set_up(lab: duralab.Lab, page: Page, pictures: Pictures, folder: Path) -> None:
    """Take the screens of a new test from a measured file."""
    page.go("new")
    page.wait("document.querySelector('select[name=beginning]')")
    page.choose("select[name=beginning]", f"rig:{RIG}")
    page.wait("document.querySelector('input[name=measured]')")
    pictures.take("new_test_start")
    written = folder / "road.rsp"
    target = lab.catalogue.target(NAME)
    channels = tuple(replace(each, name=LOGGER[each.name], unit="kN") for each in target.channels)
    samples = signal.resample(target.samples / 1000.0, int(target.duration * LOGGER_RATE), axis=1)
    write_signals(Signals(channels, LOGGER_RATE, samples), written)
    page.browser.call("DOM.enable")
    root = page.browser.call("DOM.getDocument")["root"]["nodeId"]
    node = page.browser.call("DOM.querySelector", nodeId=root, selector="input[name=measured]")["nodeId"]
    page.browser.call("DOM.setFileInputFiles", nodeId=node, files=[str(written)])
    page.wait("document.querySelector('select[name^=map]')")
    for response, channel in LOGGER.items():
        page.choose(f"select[name=map-{response}]", channel)
    pictures.take("new_test")
    page.value(
        "(() => { const e = document.querySelector('textarea[name=edit]');"
        f"e.value = {json.dumps(json.dumps(EDIT))};"
        "e.dispatchEvent(new Event('change', {bubbles: true})); })()"
    )
    page.click("#preview")
    page.wait_for_text("What the steps did")
    pictures.take("new_test_map", at=below_header("[aria-label^='Which channel']"))
    pictures.take("new_test_edit", at=below_header("textarea[name=edit]"))
    settings = "section[aria-label=Settings]"
    page.value(
        f"[...document.querySelectorAll('{settings} summary')].find((one) => one.innerText.startsWith('excitation'))"
        ".parentElement.open = true; 0"
    )
    pictures.take("settings", at=below_header(settings))
    page.write("#field-name", "road")
    page.click("#check")
    page.wait("document.querySelector('section[aria-label=\"Check and save\"] [role=status]')")
    page.value("document.querySelector('section[aria-label=\"Check and save\"] details').open = true; 0")
    pictures.take("check", at=below_header('section[aria-label="Check and save"]'))


def read(page: Page, pictures: Pictures) -> None:
    """Take the list of recordings, a report, and a comparison."""
    page.go("recordings")
    page.wait("document.querySelectorAll('tbody button').length === 2")
    page.click("tbody button")
    page.wait_for_text("whole")
    for number in (1, 2):
        page.click(f"tbody tr:nth-child({number}) input")
    page.wait_for_text("Compare 2")
    pictures.take("recordings")
    address = page.address.rstrip("/")
    compared = page.value("document.querySelector('a.button').getAttribute('href')")
    for name, path in (("report", f"/api/recordings/{NAME}/report"), ("comparison", compared)):
        page.browser.call("Page.navigate", url=f"{address}{path}")
        page.wait("document.querySelectorAll('.plot .main-svg').length > 3")
        pictures.take(name)


def take_viewer(out: Path) -> None:
    """Take the rig in the frame of the viewer while a campaign plays."""
    with (
        tempfile.TemporaryDirectory() as temporary,
        Viewer(port=0, web_port=0, native=False) as viewer,
        duralab.start(temporary, rigs=(RIG, "predecessor"), viewer=viewer.address) as lab,
    ):
        served = PageProcess(lab.endpoints[0], Path(temporary) / "page", viewer=viewer.page)
        try:
            (served.files / f"{NAME}.yaml").write_text(yaml.safe_dump(campaign() | {"hold": "first"}))
            with Browser(browser_program(), Path(temporary) / "profile", webgl=True) as browser:
                page = Page(browser, served.address)
                page.go("run")
                page.choose("select[name=campaign]", f"file:{NAME}")
                page.deliberate("section[aria-label='Begin a campaign']")
                page.wait("document.querySelector('.hold')", 300.0)
                page.go("rig")
                page.wait("document.querySelector('iframe')")
                # Drawn without a graphics card it takes its time.
                page.value("new Promise((done) => setTimeout(done, 90000))")
                shown = "document.querySelector('iframe').scrollIntoView({block: 'end'})"
                Pictures(page, out).take("rig_3d", at=shown, looks=("", "_dark"))
        finally:
            served.close()


def main() -> None:
    """Take the pictures that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    works = {"campaign": take_campaign, "endurance": take_endurance, "viewer": take_viewer}
    parser.add_argument("what", nargs="*", help=f"{', '.join(works)}; campaign and endurance if left out")
    parser.add_argument("--out", type=Path, default=OUT)
    asked = parser.parse_args()
    if unknown := [what for what in asked.what if what not in works]:
        parser.error(f"there is no part {unknown[0]!r}; give one of {', '.join(works)}")
    asked.out.mkdir(parents=True, exist_ok=True)
    for what in asked.what or ["campaign", "endurance"]:
        works[what](asked.out)


if __name__ == "__main__":
    main()
