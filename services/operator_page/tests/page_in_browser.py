"""One open page of the operator page in a real browser, driven as a person does."""

import json
import time

import pytest
from browser import Browser, browser_program

SECONDS = 60.0
IN_A_BROWSER = [
    pytest.mark.skipif(browser_program() is None, reason="no chromium here; apt-get install chromium"),
    pytest.mark.timeout(600),
]


class Page:
    """One open page, as a person has it: looks for words, clicks, types."""

    def __init__(self, browser: Browser, address: str, *, width=1920, height=1080, theme="light") -> None:
        self.browser, self.address = browser, address
        browser.call("Page.enable")
        browser.call("Runtime.enable")
        browser.call("Network.enable")
        self.look(width, height, theme)
        browser.call(
            "Page.addScriptToEvaluateOnNewDocument",
            source="self.wrong = []; addEventListener('error', (e) => wrong.push(String(e.message)));"
            "addEventListener('unhandledrejection', (e) => wrong.push(String(e.reason)));"
            "addEventListener('securitypolicyviolation', (e) => wrong.push(`policy: ${e.violatedDirective}`));",
        )
        browser.call("Page.navigate", url=address)
        self.wait("document.readyState === 'complete'")

    def look(self, width: int, height: int, theme: str) -> None:
        self.browser.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
        )
        self.browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])

    def value(self, expression: str):
        answer = self.browser.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, expression: str, seconds: float = SECONDS):
        end, slowest = time.monotonic() + seconds, 0.0
        while True:
            asked = time.monotonic()
            if self.value(f"Boolean({expression})"):
                return
            slowest = max(slowest, time.monotonic() - asked)
            assert time.monotonic() < end, (
                f"{expression}; slowest answer of the browser {slowest:.1f} s; the page says: "
                f"{self.value('document.body.innerText')[:3000]}"
            )
            time.sleep(0.02)

    def text(self, selector: str = "body") -> str:
        return self.value(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''")

    def wait_for_text(self, text: str, selector: str = "body", seconds: float = SECONDS) -> None:
        found = f"(document.querySelector({json.dumps(selector)})?.innerText ?? '').includes({json.dumps(text)})"
        self.wait(found, seconds)

    def go(self, screen: str) -> None:
        self.value(f"location.hash = {screen!r}; 0")
        self.wait(f"document.querySelector('nav a[aria-current]')?.hash === '#{screen}'")

    def place(self, selector: str) -> dict:
        """Scroll to an element and return where its middle is."""
        found = f"document.querySelector({json.dumps(selector)})"
        self.wait(f"{found} && !{found}.disabled")
        return self.value(
            f"(() => {{ const e = {found}; e.scrollIntoView({{block: 'center'}});"
            "const r = e.getBoundingClientRect(); return {x: r.x + r.width / 2, y: r.y + r.height / 2}; })()"
        )

    def click(self, selector: str) -> None:
        at = self.place(selector)
        for kind in ("mousePressed", "mouseReleased"):
            self.browser.call("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, **at)

    def key(self, key: str, **also) -> None:
        for kind in ("keyDown", "keyUp"):
            self.browser.call(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                code=also.get("code", key),
                **{k: v for k, v in also.items() if k not in ("code",) and (kind == "keyDown" or k != "text")},
            )

    def tab_and_do(self, arm: str) -> None:
        """Do both acts by keyboard, from the field before them; the second has the focus after the first.

        On a busy machine what was armed may be disarmed again before it is seen: then the first is done again.
        """
        self.wait(f"!document.querySelector({json.dumps(arm)}).disabled")
        self.value("self.before = document.activeElement; 0")
        for _ in range(3):
            self.value("before.focus()")
            self.key("Tab", windowsVirtualKeyCode=9)
            self.key("Enter", text="\r", windowsVirtualKeyCode=13)
            end = time.monotonic() + 12.0
            while not (armed := self.value("document.activeElement.className.includes('go')")):
                if time.monotonic() > end:
                    break
                time.sleep(0.02)
            if armed:
                break
        self.wait("document.activeElement.className.includes('go')", 1.0)
        self.key("Enter", text="\r", windowsVirtualKeyCode=13)

    def tab_to(self, selector: str) -> None:
        """Press Tab until an element has the focus, from wherever the focus is."""
        self.wait(f"document.querySelector({json.dumps(selector)})")
        for _ in range(200):
            if self.value(f"document.activeElement.matches({json.dumps(selector)})"):
                return
            self.key("Tab", windowsVirtualKeyCode=9)
        raise AssertionError(f"Tab never reaches {selector}")

    def write(self, selector: str, text: str) -> None:
        self.place(selector)
        self.value(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)}); e.focus(); e.select?.(); }})()"
        )
        self.browser.call("Input.insertText", text=text)

    def choose(self, selector: str, value: str) -> None:
        self.wait(
            f"[...document.querySelector({json.dumps(selector)})?.options ?? []].some((o) => o.value === {value!r})"
        )
        self.value(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)}); e.value = {value!r};"
            "e.dispatchEvent(new Event('change', {bubbles: true})); })()"
        )

    def deliberate(self, within: str) -> None:
        """Do both acts with the mouse; a click that something moved away from is done again, as a person does."""
        for _ in range(5):
            self.click(f"{within} .arm")
            end = time.monotonic() + 3.0
            while (
                not (armed := self.value(f"Boolean(document.querySelector({json.dumps(within + ' .go')}))"))
                and time.monotonic() < end
            ):
                time.sleep(0.05)
            if armed:
                break
        self.click(f"{within} .go")


def decide(page: Page, proposal: int, kind: str = "play", *, reason: str = "as foreseen") -> None:
    page.wait_for_text(f"on proposal {proposal},", ".activity")
    page.click(f".hold input[value={kind}]")
    page.write(".hold input[name=reason]", reason)
