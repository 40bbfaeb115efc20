"""Write the pictures of docs/guides/operator_page.md: `python services/operator_page/tests/make_pictures.py`.

A lab of the simulated front axle runs a campaign in real time, and a linear rig an endurance test until its specimen
cracks. `endurance` or `campaign` as an argument takes the pictures of one of them.
"""

import io
import sys
import tempfile
from pathlib import Path

import yaml

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
sys.path[:0] = [str(HERE), str(HERE / "long"), str(ROOT / "duralab" / "tests")]

from browser import Browser, browser_program  # noqa: E402
from page_lab import Client, PageLab, PageProcess, schedule  # noqa: E402
from PIL import Image  # noqa: E402
from test_page_in_browser import Page, decide  # noqa: E402

import duralab  # noqa: E402
from duralab.formats import write_signals  # noqa: E402
from duralab.processes import Viewer  # noqa: E402

OUT = ROOT / "docs" / "pictures"
RIG = "front_axle_compliant"
SIZES = {"wide": (1600, 900), "tablet": (1024, 1180)}


def picture(page: Page, name: str, *, theme: str = "light", size: str = "wide") -> None:
    """Take a picture of what stands at the top of a screen, in few colours: it is small, and its text stays sharp."""
    page.look(*SIZES[size], theme)
    page.value("new Promise((done) => setTimeout(done, 700))")
    image = Image.open(io.BytesIO(page.browser.picture())).convert("RGB").quantize(128, dither=Image.Dither.NONE)
    image.save(OUT / f"operator_page_{name}.png", optimize=True)
    page.look(*SIZES["wide"], "light")


def campaign() -> dict:
    """The demo on the compliant rig, a few seconds of it, held before each playback."""
    shipped = Path(duralab.__file__).with_name("campaign") / "shipped" / "front_axle_demo.yaml"
    document = yaml.safe_load(shipped.read_text())
    document |= {"name": "belgian_block_left", "rig": RIG, "hold": "each", "real_time": True}
    rms = [0.004, 0.003, 0.001] * 2
    document["excitation"] |= {"rms": dict(zip(document["excitation"]["rms"], rms, strict=True)), "duration": 40.0}
    document["target"]["road"] |= {
        "duration": 12.0,
        "potholes": {"count": 1, "depth": [0.02, 0.03], "length": [0.4, 0.8]},
    }
    document["update"], document["stop"]["iterations"] = {"kind": "basic_twr", "iteration_gain": 0.7}, 3
    return document


def main() -> None:
    """Take the pictures that are asked for."""
    for name, work in (("campaign", take_campaign), ("endurance", take_endurance)):
        if name in sys.argv[1:] or not sys.argv[1:]:
            work()


def take_endurance() -> None:
    """Run an endurance test until its specimen cracks."""
    with tempfile.TemporaryDirectory() as temporary, PageLab(Path(temporary)) as lab:
        served = lab.page("page")
        lab.put_schedule(served, schedule("weeks", keep={"first": 3, "every": 100, "around_alarm": 2}))
        with Browser(browser_program(), Path(temporary) / "profile") as browser:
            begun = Client(served.address).act("/api/endurance", {"name": "weeks"})
            assert begun[0] == 200, begun
            page = Page(browser, served.address, width=1600, height=900)
            page.go("endurance")
            page.wait("Number(document.querySelector('.activity strong')?.innerText) > 60", 300.0)
            picture(page, "endurance")
            lab.rig.cracked = True
            page.wait("document.querySelector('.hold')", 300.0)
            page.wait("document.querySelector('.level')", 300.0)
            picture(page, "endurance_hold")
            picture(page, "endurance_dark", theme="dark", size="tablet")


def take_campaign() -> None:
    """Run the campaign by hand and take the pictures on the way."""
    with (
        tempfile.TemporaryDirectory() as temporary,
        Viewer(port=0, web_port=0, native=False) as viewer,
        duralab.start(temporary, rigs=(RIG, "predecessor"), viewer=viewer.address) as lab,
    ):
        folder = Path(temporary)
        served = PageProcess(lab.endpoints[0], folder / "page", viewer=viewer.page)
        try:
            with Browser(browser_program(), folder / "profile") as browser:
                take(lab, served, browser, folder)
        finally:
            served.close()


def take(lab: duralab.Lab, served: PageProcess, browser: Browser, folder: Path) -> None:
    """Take all pictures."""
    (served.files / "belgian_block_left.yaml").write_text(yaml.safe_dump(campaign()))
    page = Page(browser, served.address, width=1600, height=900)
    page.go("run")
    page.choose("select[name=campaign]", "file:belgian_block_left")
    page.click("section[aria-label='Begin a campaign'] .arm")
    page.wait("document.querySelector('.go')")
    picture(page, "armed")
    page.wait("!document.querySelector('.go')", 12.0)
    page.deliberate("section[aria-label='Begin a campaign']")
    decide(page, 1)
    page.deliberate(".hold")
    decide(page, 2)
    page.wait("document.querySelectorAll('.hold canvas').length === 12")
    picture(page, "hold")
    picture(page, "hold_dark", theme="dark", size="tablet")
    page.deliberate(".hold")
    page.wait_for_text("playing", "h1 .mode")
    page.value("new Promise((done) => setTimeout(done, 4000))")
    picture(page, "run")
    page.go("lab")
    picture(page, "lab")
    decide_end(page)
    page.click("#stop")
    page.go("rig")
    page.wait_for_text("interlocked", ".large")
    picture(page, "rig")
    # Drawn without a graphics card it takes its time.
    page.value("new Promise((done) => setTimeout(done, 60000))")
    page.value("document.querySelector('iframe').scrollIntoView({block: 'end'}); 0")
    picture(page, "rig_3d")
    page.go("recordings")
    page.wait("document.querySelector('tbody button')")
    page.click("tbody button")
    page.wait_for_text("whole")
    picture(page, "recordings")
    page.go("new")
    page.choose("select[name=beginning]", f"rig:{RIG}")
    page.wait("document.querySelector('input[name=measured]')")
    written = folder / "proving_ground.rsp"
    write_signals(lab.catalogue.target("belgian_block_left"), written)
    browser.call("DOM.enable")
    root = browser.call("DOM.getDocument")["root"]["nodeId"]
    node = browser.call("DOM.querySelector", nodeId=root, selector="input[name=measured]")["nodeId"]
    browser.call("DOM.setFileInputFiles", nodeId=node, files=[str(written)])
    page.wait("document.querySelector('select[name^=map]')")
    picture(page, "new_test")
    settings = "document.querySelector('section[aria-label=Settings]')"
    page.value(
        f"{settings}.querySelectorAll('details')[1].open = true; {settings}.scrollIntoView(); scrollBy(0, -70); 0"
    )
    picture(page, "settings")


def decide_end(page: Page) -> None:
    """End the campaign at its last hold point, so that its recording is closed."""
    page.go("run")
    decide(page, 3, "end", reason="the picture is taken")
    page.deliberate(".hold")
    page.wait("document.querySelector('.resume')")


if __name__ == "__main__":
    main()
