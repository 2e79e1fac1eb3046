"""The studio's core pages in a real browser on the real server, on synthetic sources."""

import json
import os
import re
import subprocess
import urllib.request

import pages
from pages import shot

NAV = ["Home", "Live", "Plates", "People", "Reconstruct", "Annotate", "Calibrate", "Train", "Explore", "System", "API"]
SMALL = "synth:portrait?live=1&fps=8&size=320x240"  # leaves the processor to others
IMAGE = "document.querySelector('.live-view:not(.is-waiting) canvas')"


def width_of(jpeg):
    """Size of a JPEG, by its frame header."""
    at = 2
    while jpeg[at + 1] not in (0xC0, 0xC1, 0xC2):
        at += 2 + int.from_bytes(jpeg[at + 2:at + 4], "big")
    return int.from_bytes(jpeg[at + 7:at + 9], "big")


def sum_of_canvas():
    """A number that in practice differs between two images."""
    return """(() => {
      const canvas = document.querySelector('.live-view canvas');
      const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
      let sum = 0;
      for (let i = 0; i < data.length; i += 997) sum = (sum * 31 + data[i]) % 1000000007;
      return sum;
    })()"""


class SignInTest(pages.PageTest):
    def test_the_link_signs_in_once_and_leaves_the_address(self):
        page = self.page
        self.assertNotIn("#", page.evaluate("location.href"))
        other = self.browser.page(width=360, height=800, context=self.browser.new_context())
        other.open(self.server.link)
        other.wait_text("tarsier serve --link")
        self.assertNotIn("#", other.evaluate("location.href"))
        # The reason in the server's own words. The browser's log reports the refusal itself.
        self.assertTrue(other.evaluate("document.querySelector('.notice-problem')?.innerText.length > 10"))
        other.complaints()
        source = pages.axe_source()
        if source:
            self.assertEqual(other.axe(source), [])
        for width in (360, 800, 1440):
            other.resize(width, 800)
            shot(other, f"sign-in-{width}")
            self.assertIsNone(other.overflow())
        # A new link, pasted by hand.
        other.fill("textbox", "Link or token", self.server.new_link())
        other.click("button", "Sign in")
        other.wait("document.querySelector('main[data-page=home]')")
        self.assertEqual(other.complaints(), [])
        other.close()

    def test_signing_out_shows_the_sign_in_page(self):
        other = self.browser.page(context=self.browser.new_context())
        self.sign_in(other, self.server.new_link())
        other.open(self.server.origin + "/system")
        other.click("button", "Sign out")
        other.wait_text("tarsier serve --link")
        other.open(self.server.origin + "/live")
        other.wait_text("tarsier serve --link")
        other.close()


class HomeTest(pages.PageTest):
    def test_home(self):
        self.go("/")
        self.page.wait_text("This machine is ready")
        for title in ("Cartoon", "Number plates", "Facial landmarks", "Head pose", "People", "Markers",
                      "Appearance models", "Structure from motion", "Calibration"):
            self.assertTrue(self.page.has("heading", title), title)
        self.check_page("home")

    def test_each_card_starts_at_once(self):
        self.go("/")
        cards = self.page.evaluate("[...document.querySelectorAll('.area .button-main')].map((one) => one.getAttribute('aria-label'))")
        self.assertEqual(len(cards), 9)
        for card in cards:
            self.assertRegex(card, "^Try it: .*, with synthetic data$")
        # Links that begin no session of an area page are tested elsewhere; these two have their own path.
        self.page.click("button", "Try it: Calibration, with synthetic data")
        self.page.wait("location.pathname.startsWith('/session/')")
        self.page.wait(IMAGE, what="the board")
        self.page.click("button", "End")
        self.page.wait("location.pathname === '/live'")
        self.go("/")
        self.page.click("link", "Try it: Structure from motion, with synthetic data")
        self.page.wait("location.pathname === '/reconstruct' && !location.search.includes('try')")
        self.page.wait_text("images of a synthetic scene are being generated")
        jobs = self.until("a model is made", lambda: self.jobs_of("sfm reconstruct"))
        self.assertEqual(len(jobs), 1, "one click, one model")
        self.server.call(f"/api/jobs/{jobs[0]['id']}/cancel", {})

    def test_every_page_opens_from_the_menu_by_keyboard(self):
        self.go("/")
        for name in NAV:
            self.page.focus("link", name)
            self.page.press("Enter")
            path = "/" if name == "Home" else f"/{name.lower()}"
            self.page.wait(f"location.pathname === {json.dumps(path)} && document.querySelector('main[data-ready=yes] h1')")
            # The new page's heading has the focus.
            self.assertEqual(self.page.evaluate("document.querySelectorAll('h1').length"), 1, name)
        self.page.evaluate("history.back()")
        self.page.wait("location.pathname === '/system'")

    def test_on_a_phone_the_menu_opens(self):
        self.page.resize(360, 740)
        self.go("/")
        self.assertFalse(self.page.has("link", "Plates"))
        self.page.click("button", "Menu")
        self.page.find("link", "Plates")
        shot(self.page, "menu-360")
        self.page.click("link", "System")
        self.page.wait("document.querySelector('main[data-page=system][data-ready=yes]')")

    def test_the_skip_link_comes_first(self):
        self.go("/")
        self.page.evaluate("document.activeElement.blur()")
        self.page.press("Tab")
        self.assertEqual(self.page.evaluate("document.activeElement.textContent"), "Skip to the content")

    def test_colours_can_be_chosen_and_stay(self):
        self.go("/")
        self.page.click("button", contains="Theme: auto")
        self.page.click("button", contains="Theme: light")
        self.page.wait("document.documentElement.dataset.theme === 'dark'")
        self.page.reload()
        self.page.wait("document.documentElement.dataset.theme === 'dark'")
        self.page.click("button", contains="Theme: dark")
        self.page.wait("document.documentElement.dataset.theme === undefined")

    def test_a_missing_page(self):
        self.go("/nothing-here")
        self.assertTrue(self.page.has("heading", "This page does not exist"))
        self.page.click("link", "Go to the home page")
        self.page.wait("document.querySelector('main[data-page=home]')")

    def test_the_findings_of_doctor_are_shown(self):
        status, answer = self.server.call("/api/run", {"verb": "doctor", "inputs": [], "flags": {}})
        self.assertEqual(status, 200)
        count = len(answer["lines"][0]["items"])
        self.go("/")
        self.page.wait_text(f"{count} checks")


class SessionTest(pages.PageTest):
    def tearDown(self):
        try:
            super().tearDown()
        finally:
            self.page.open("about:blank")  # a page must not request a session that has ended
            for session in self.server.call("/api/sessions")[1]["sessions"]:
                self.server.call(f"/api/sessions/{session['id']}", method="DELETE")

    def start(self, verb, source, flags=None, name=None):
        request = {"verb": verb, "inputs": [source], "flags": flags or {}}
        if name:
            request["name"] = name
        status, answer = self.server.call("/api/sessions", request)
        self.assertEqual(status, 201, answer)
        return answer["id"]

    def test_a_first_visitor_gets_a_live_image_in_one_click(self):
        self.go("/")
        self.page.click("button", "Try it: Cartoon, with synthetic data")
        self.page.wait(IMAGE, what="a live image")
        self.page.wait("document.querySelector('.live-status').innerText !== 'Waiting for the first image.'")
        self.page.wait("/frames\\/s/.test(document.querySelector('.figures').innerText)")
        first = self.page.evaluate("location.pathname.split('/').pop()")
        # A source that leaves the processor to the checks.
        self.go(f"/session/{self.start('cartoon run', SMALL)}")
        self.server.call(f"/api/sessions/{first}", method="DELETE")
        self.page.wait(IMAGE)
        self.page.wait("/frames\\/s/.test(document.querySelector('.figures').innerText)")
        self.check_page("session")

    def test_actions_sliders_and_keys_change_the_image(self):
        id = self.start("cartoon run", SMALL)
        self.go(f"/session/{id}")
        self.page.wait(IMAGE)
        self.page.click("button", contains="pencil sketch")
        mode = "document.querySelector('.live-status').innerText.toLowerCase()"
        self.page.wait(f"{mode}.includes('sketch')", what="the sketch in the status")
        # Each action of the session is a button, and none of them breaks the session.
        actions = self.server.call(f"/api/sessions/{id}")[1]["actions"]
        shown = [one["name"] for one in actions if one["name"] not in ("quit", "help", "fullscreen", "save")]
        for name in shown:
            self.page.evaluate(f"document.querySelector('[data-action={json.dumps(name)}]').click()")
        self.page.wait(IMAGE)
        self.assertTrue(self.server.call(f"/api/sessions/{id}")[1]["running"])
        # Keys: the image gets the focus in Tab order and receives keys; Tab leaves it.
        self.page.on(self.page.find("application", contains="Live image"), "function () { this.focus(); }")
        self.page.press("s")
        self.page.wait(f"{mode}.includes('sketch')")
        self.page.press("p")
        self.page.wait(f"!{mode}.includes('sketch')")
        self.page.press("Tab")
        self.assertNotEqual(self.page.evaluate("document.activeElement.tagName"), "CANVAS")
        # q and Escape do not end a session by accident.
        self.page.on(self.page.find("application", contains="Live image"), "function () { this.focus(); }")
        self.page.press("q")
        self.page.press("Escape")
        self.page.press("s")
        self.page.wait(f"{mode}.includes('sketch')")
        self.assertTrue(self.server.call(f"/api/sessions/{id}")[1]["running"])
        sliders = self.server.call(f"/api/sessions/{id}")[1]["sliders"]
        for slider in sliders:
            label = slider["name"].replace("-", " ")
            label = label[0].upper() + label[1:]
            self.page.slide(label, slider["low"])
            self.page.slide(label, slider["high"])
            self.page.wait_posts()

    def test_state_log_command(self):
        id = self.start("ar markers", "synth:markers?live=1&fps=4", {"--focal": 608, "--draw": "cube"})
        self.go(f"/session/{id}")
        self.page.wait(IMAGE)
        self.page.click("tab", "State")
        self.page.wait("document.querySelectorAll('.session-side tbody tr').length > 1")
        self.check_page("session-state", widths=(360, 1440))
        self.page.click("button", "JSON")
        self.page.wait("JSON.parse(document.querySelector('.session-side pre').innerText)")
        self.page.focus("tab", "State")
        self.page.press("ArrowRight")
        self.page.wait("document.querySelector('[role=tab][aria-selected=true]').innerText === 'Log'")
        self.page.press("ArrowRight")
        self.page.wait("document.querySelector('.command code')?.innerText.startsWith('tarsier ar markers')")

    def test_settings_restart_the_session(self):
        self.go("/")
        self.page.click("button", "Try it: Head pose, with synthetic data")
        self.page.wait(IMAGE)
        id = self.page.evaluate("location.pathname.split('/').pop()")
        self.page.click("button", "Settings")
        self.page.wait("document.querySelector('dialog[open] .command code').innerText.includes('--draw glasses')")
        self.page.wait("[...document.querySelectorAll('dialog select, dialog input')].some((one) => one.value === 'glasses')")
        self.check_page("settings", widths=(360, 1440))
        self.page.fill("textbox", "Draw", "box")
        self.page.wait("document.querySelector('dialog .command code').innerText.includes('--draw box')")
        self.page.click("button", "Restart with these settings")
        self.page.wait(f"location.pathname.startsWith('/session/') && !location.pathname.endsWith('/{id}')")
        self.page.wait(IMAGE)
        running = [one for one in self.server.call("/api/sessions")[1]["sessions"] if one["running"]]
        self.assertEqual(len(running), 1)
        self.assertIn("box", running[0]["command"])

    def test_pop_out_and_snapshot_and_record(self):
        id = self.start("cartoon run", SMALL)
        self.go(f"/session/{id}")
        self.page.wait(IMAGE)
        folder = os.path.join(self.server.workspace, "downloads")
        os.makedirs(folder, exist_ok=True)
        self.browser.send("Browser.setDownloadBehavior",
                          {"behavior": "allow", "downloadPath": folder, "browserContextId": self.context})
        self.page.click("button", "Snapshot")
        self.wait_file(folder, ".jpg", b"\xff\xd8")
        self.page.click("button", "Record")
        self.page.wait_text("Stop recording (1 s)")
        self.page.click("button", contains="Stop recording")
        self.wait_file(folder, ".webm", b"\x1a\x45\xdf\xa3")
        self.page.click("button", "Pop out")
        self.page.wait("true")
        found = self.until("a window popped out",
                           lambda: [one for one in self.browser.targets() if "only=image" in one["url"]])
        window = self.browser.attach(found[0]["targetId"])
        window.wait(IMAGE)
        shot(window, "popout")
        self.assertEqual(window.complaints(), [])
        window.close()

    def wait_file(self, folder, ending, magic):
        def is_there():
            for name in os.listdir(folder):
                if name.endswith(ending):
                    with open(os.path.join(folder, name), "rb") as file:
                        return file.read(len(magic)) == magic
            return False

        self.until(f"a file *{ending}", is_there)

    def test_stages_are_shown_on_request(self):
        id = self.start("cartoon run", SMALL, {"--mode": "cartoon"})
        self.go(f"/session/{id}")
        self.page.wait(IMAGE)
        self.assertFalse(self.page.evaluate("Boolean(document.querySelector('.stages'))"))
        self.page.click("button", "Stages")
        self.page.wait("document.querySelectorAll('.stage-row img').length >= 4", what="the stages")
        self.page.wait("[...document.querySelectorAll('.stage-row img')].every((one) => one.complete && one.naturalWidth > 50)")
        frame = int(self.page.evaluate("document.querySelector('.stage-row').dataset.frame"))
        self.page.wait(f"Number(document.querySelector('.stage-row').dataset.frame) > {frame}", what="stages of a later frame")
        self.check_page("session-stages")
        self.page.evaluate("document.querySelector('.stage-row button').focus()")
        self.page.press("Enter")
        self.page.wait("document.querySelector('dialog[open] .stage-large')?.naturalWidth > 50")
        self.page.press("Escape")
        self.page.wait("!document.querySelector('dialog[open]')")
        self.page.click("button", "Stages")
        self.page.wait("!document.querySelector('.stages')")
        # Also for sessions with slow first frames.
        for verb, name in (("pose track", b"second/mean"), ("people live", b"illumination normalised")):
            id = self.start(verb, SMALL)
            self.go(f"/session/{id}")
            self.page.wait(IMAGE)
            self.page.click("button", "Stages")
            self.page.wait("document.querySelectorAll('.stage-row img').length >= 4", what=f"the stages of {verb}")
            status, record = self.server.call(f"/api/sessions/{id}/stages")
            self.assertEqual(status, 200)
            self.assertIn(name, record)
            self.check_page(f"session-stages-{verb.replace(' ', '-')}")
            self.server.call(f"/api/sessions/{id}", method="DELETE")
        self.server.call("/api/state/gallery", method="DELETE")  # of people live
        # A session without stages has no such button, and reports this to programs.
        other = self.start("calibrate", "synth:board?live=1&fps=8&size=480x360")
        self.assertEqual(self.server.call(f"/api/sessions/{other}/stages")[0], 409)
        self.assertEqual(self.server.call("/api/sessions/none/stages")[0], 404)

    def test_keys_can_be_changed(self):
        id = self.start("cartoon run", SMALL)
        self.go(f"/session/{id}")
        self.page.wait(IMAGE)
        mode = "document.querySelector('.live-status').innerText.toLowerCase()"
        key = "document.querySelector('[data-key-of=sketch]').innerText"
        self.page.click("tab", "Keys")
        self.page.evaluate("document.querySelector('[data-key-of=sketch]').click()")
        self.page.wait(f"{key} === 'Press a key'")
        self.page.press("p")  # the key of oil paint
        self.page.wait("document.querySelector('.keys .notice-problem')?.innerText.includes('is already the key of')")
        self.page.press("x")
        self.page.wait(f"{key} === 'x'")
        self.check_page("session-keys", widths=(360, 1440))
        # The setting is kept in this browser.
        self.page.reload()
        self.page.wait(IMAGE)
        self.page.wait("document.querySelector('[data-action=sketch] kbd')?.innerText === 'x'")
        focus = "function () { this.focus(); }"
        self.page.on(self.page.find("application", contains="Live image"), focus)
        self.page.press("p")
        self.page.wait(f"{mode}.includes('paint')")
        self.page.press("s")  # has no effect now
        self.page.press("x")
        self.page.wait(f"{mode}.includes('sketch')")
        self.page.click("tab", "Keys")
        self.page.click("button", "Reset all keys")
        self.page.wait(f"{key} === 's'")
        self.assertEqual(self.page.evaluate("localStorage.getItem('tarsier.keys')"), "{}")

    def test_images_have_the_displayed_size(self):
        id = self.start("cartoon run", "synth:portrait?live=1&fps=4&size=1280x960", {"--mode": "none"})
        self.go("/live")
        width = "document.querySelector('.live-view:not(.is-waiting) canvas')?.width"
        self.page.wait(f"{width} > 100 && {width} <= 640", what="a small image on the wall")
        sent = self.page.evaluate(width)
        # A viewer can request the full size, and the wall returns to a smaller one.
        self.assertEqual(width_of(self.server.call(f"/api/sessions/{id}/snapshot.jpg")[1]), 1280)
        self.page.wait(f"{width} === {sent}")
        # On its own page, and in a recording, it is larger.
        self.go(f"/session/{id}")
        self.page.wait(f"{width} > {sent}", what="a larger one on its own page")
        self.page.click("button", "Record")
        self.page.wait(f"{width} === 1280", what="the whole image while it is recorded")

    def test_a_click_on_the_image_reaches_the_session_at_the_right_pixel(self):
        id = self.start("cartoon run", SMALL)
        self.go(f"/session/{id}")
        self.page.wait(IMAGE)
        self.page.evaluate("""(() => {
          const real = window.fetch;
          window.sent = [];
          window.fetch = (path, options) => {
            if (String(path).endsWith('/events')) window.sent.push(...JSON.parse(options.body));
            return real(path, options);
          };
        })()""")
        box = self.page.evaluate("""(() => {
          const one = document.querySelector('.live-view canvas');
          const box = one.getBoundingClientRect();
          const scale = Math.min(box.width / one.width, box.height / one.height);
          return {x: box.left + box.width / 2, y: box.top + box.height / 2, shown: one.width * scale};
        })()""")
        # The server may send the image in another size between now and the click. An event states the image width to which its
        # pixels refer.
        self.page.click_at(box["x"] + box["shown"] / 8, box["y"] - box["shown"] / 16)
        self.page.wait("window.sent.some((one) => one.mouse === 'left-up')")
        down = self.page.evaluate("window.sent.find((one) => one.mouse === 'left-down')")
        width, height = down["width"], down["width"] * 3 / 4
        self.assertAlmostEqual(down["x"], width * (1 / 2 + 1 / 8) - 0.5, delta=1)
        self.assertAlmostEqual(down["y"], height / 2 - width / 16 - 0.5, delta=1)
        self.page.reload()
        self.page.wait(IMAGE)

    def test_a_session_that_ended_can_be_restarted(self):
        id = self.start("cartoon run", "synth:portrait?frames=5")
        self.go(f"/session/{id}")
        self.page.wait_text("The session ended.")
        self.page.click("button", "Restart")
        self.page.wait(f"location.pathname.startsWith('/session/') && location.pathname !== '/session/{id}'")
        self.page.wait_text("The session ended.")
        self.page.click("button", "Remove")
        self.page.wait("location.pathname === '/live'")
        self.go(f"/session/{self.start('cartoon run', 'synth:portrait?live=1&fps=8&size=320x240')}")
        self.page.wait(IMAGE)
        self.page.click("button", "End")
        self.page.wait("location.pathname === '/live'")
        self.go("/session/nothing")
        self.page.wait("document.querySelector('.notice-problem')")
        complaints = self.page.complaints()
        self.assertTrue(all("404" in one for one in complaints), complaints)

    def test_own_camera_becomes_a_source(self):
        self.go("/")
        self.page.click("button", "My camera: Cartoon")
        self.page.wait(IMAGE, what="the cartoon of the browser's camera")
        self.page.wait_text("Your camera is on")
        self.page.wait("/frames\\/s/.test(document.querySelector('.camera-bar').innerText)")
        first = self.page.evaluate(sum_of_canvas())
        self.page.wait(f"({sum_of_canvas()}) !== {first}", what="an image that moves")
        shot(self.page, "own-camera")
        self.page.click("button", "Stop it")
        self.page.wait("!document.querySelector('.camera-bar')")

    def test_start_dialog(self):
        self.go("/live")
        self.page.click("button", "Start a session")
        self.page.wait("document.querySelector('dialog[open] select')")
        self.page.choose("Verb", "ar markers")
        self.page.wait("document.querySelector('dialog .command code').innerText.includes('synth:markers')")
        self.check_page("start", widths=(360, 800, 1440))
        self.page.press("Escape")
        self.page.wait("!document.querySelector('dialog[open]')")
        self.page.click("button", "Start a session")
        self.page.choose("Verb", "cartoon run")
        self.page.click("button", "Start")
        self.page.wait("location.pathname.startsWith('/session/')")
        self.page.wait(IMAGE)

    def test_wall(self):
        self.go("/live")
        self.page.wait_text("No session is running")
        self.check_page("live-empty", widths=(360, 1440))
        for mode in ("sketch", "paint", "cartoon", "evil"):
            self.start("cartoon run", f"synth:portrait?live=1&fps=3&size=320x240&seed={len(mode)}", {"--mode": mode},
                       f"Portrait <b>{mode}</b>")
        self.page.wait("document.querySelectorAll('.tile .live-view:not(.is-waiting) canvas').length === 4",
                       what="four live images")
        # Names are shown as text.
        self.page.wait_text("Portrait <b>sketch</b>")
        self.assertFalse(self.page.evaluate("Boolean(document.querySelector('.tile b'))"))
        self.page.wait("[...document.querySelectorAll('.figures')].every((one) => /frames/.test(one.innerText))")
        self.check_page("live")
        # One line for all of them.
        streams = [one for one in self.page.requests() if "/api/live" in one]
        self.assertIn("%2C" if "%2C" in streams[-1] else ",", streams[-1])
        self.page.click("button", "End Portrait <b>evil</b>")
        self.page.wait("document.querySelectorAll('.tile').length === 3")

    def test_a_hidden_tab_closes_its_stream(self):
        id = self.start("cartoon run", SMALL)
        self.go(f"/session/{id}")
        self.page.wait(IMAGE)
        self.page.evaluate("""(() => {
          Object.defineProperty(document, 'visibilityState', {value: 'hidden', configurable: true});
          document.dispatchEvent(new Event('visibilitychange'));
        })()""")
        self.until("nobody looks", lambda: self.server.call(f"/api/sessions/{id}")[1]["viewers"] == 0)
        self.page.evaluate("""(() => {
          delete document.visibilityState;
          document.dispatchEvent(new Event('visibilitychange'));
        })()""")
        first = self.page.evaluate(sum_of_canvas())
        self.page.wait(f"({sum_of_canvas()}) !== {first}", what="images again")


class TabsTest(pages.PageTest):
    """A browser opens six connections to a server for all its tabs. Each visible tab has a live stream."""

    own_server = True

    def figure(self, name):
        found = re.findall(rf"^{name}(?:{{[^}}]*}})? (\S+)$", self.server.call("/metrics")[1].decode(), re.M)
        return sum(map(float, found))

    def test_six_tabs_receive_images_and_hidden_ones_none(self):
        ids = [self.server.call("/api/sessions", {"verb": "cartoon run", "flags": {"--mode": "none"},
                                                  "inputs": [f"synth:portrait?live=1&fps=3&size=160x120&seed={n}"]})[1]["id"] for n in range(6)]
        self.page.open("about:blank")
        tabs = [self.browser.page(width=480, height=400, context=self.context, window=True) for _ in ids]
        for tab, id in zip(tabs, ids):
            tab.open(self.server.origin + f"/session/{id}")
            tab.wait(IMAGE)
        for tab in tabs:
            self.assertEqual(tab.evaluate("document.visibilityState"), "visible")
            first = tab.evaluate(sum_of_canvas())
            tab.wait(f"({sum_of_canvas()}) !== {first}", what="an image that moves")
        # Other requests of a page are answered meanwhile.
        for tab in (tabs[0], tabs[5]):
            tab.click("button", contains="pencil sketch")
            tab.wait("document.querySelector('.live-status').innerText.toLowerCase().includes('sketch')")
            self.assertEqual(tab.complaints(), [])
        for tab in tabs[:5]:
            tab.close()
        # A tab in front hides the last one. The browser does this, not a page.
        front = self.browser.page(width=480, height=400, context=self.context, window=False)
        tabs[5].wait("document.visibilityState === 'hidden'")
        self.until("no viewer is left", lambda: self.figure("tarsier_session_viewers") == 0)
        frames, sent = self.figure("tarsier_session_frames_total"), self.figure("tarsier_http_sent_bytes_total")
        asked = 0
        while self.figure("tarsier_session_frames_total") < frames + 30:  # five of each session
            asked += 1
            self.assertEqual(self.figure("tarsier_session_viewers"), 0)
            front.evaluate("new Promise((done) => setTimeout(done, 200))")
        each = len(self.server.call("/metrics")[1])
        used = self.figure("tarsier_http_sent_bytes_total") - sent
        self.assertLess(used, (2 * asked + 4) * (each + 200), "more than the figures themselves was sent")
        front.close()
        first = tabs[5].evaluate(sum_of_canvas())
        tabs[5].wait(f"({sum_of_canvas()}) !== {first}", what="images again")
        tabs[5].close()


class LostServerTest(pages.PageTest):
    own_server = True

    def test_the_page_reports_a_lost_server_and_reconnects(self):
        self.go("/live")
        self.page.wait_text("No session is running")
        port = self.server.port
        self.server.stop()
        self.page.wait_text("The server does not respond")
        self.page.complaints()  # refused connections
        pages.free_port = lambda: port
        self.server.start()
        self.page.wait("!document.body.innerText.includes('The server does not respond')")
        self.page.complaints()


class SystemTest(pages.PageTest):
    def token(self):
        with open(os.path.join(self.server.workspace, ".studio", "api-token"), encoding="utf-8") as file:
            return file.read()

    def test_system(self):
        self.go("/system")
        self.page.wait("document.querySelectorAll('tbody tr').length > 3")
        self.check_page("system")
        self.page.click("tab", "Checks")
        self.page.wait("document.querySelectorAll('.chip').length > 5")
        self.check_page("system-checks", widths=(360, 1440))
        self.page.click("tab", "Models")
        self.page.find("button", "About face-detector")
        self.check_page("system-models", widths=(360, 1440))
        self.page.click("button", "About face-detector")
        self.page.wait("document.querySelector('dialog[open] tbody tr')")
        shot(self.page, "system-model")
        self.page.press("Escape")
        self.page.click("button", "Check the files’ hashes")
        self.page.wait_text("No file was changed")
        self.server.call("/api/sets", {"name": "holiday"})
        self.page.click("tab", "Disk")
        self.page.click("button", "Remove holiday")
        self.page.click("button", "Cancel")
        self.check_page("system-disk", widths=(360, 1440))
        self.page.click("button", "Remove holiday")
        self.page.click("button", "Remove it")
        self.page.wait_text("Nothing is stored yet.")
        # A bench is a job; its lines form a table.
        self.page.click("tab", "Benchmarks")
        self.page.choose("Benchmark", "bench posit")
        self.page.click("button", "Start the benchmark")
        self.page.wait("document.querySelector('main table caption')?.innerText.includes('posit: ')", what="its figures")
        self.page.wait("document.querySelectorAll('main tbody tr').length > 1")
        self.page.wait_text("done")
        self.check_page("system-bench")
        # After signing out, no further data is visible, also in open pages.
        other = self.browser.page(context=self.browser.new_context())
        self.sign_in(other, self.server.new_link())
        self.page.click("tab", "Sign-ins")
        self.page.wait("document.querySelectorAll('main tbody tr').length >= 2")
        self.page.wait_text("this one")
        self.assertIn("Chrome on Linux", self.page.text("main tbody"))
        self.assertIn("127.0.0.1", self.page.text("main tbody"))
        self.check_page("system-sign-ins")
        other.open(self.server.origin + "/live")
        other.wait_text("No session is running")
        self.page.click("button", contains="Sign all others out")
        self.page.click("button", "Sign them out")
        self.page.wait("document.querySelectorAll('main tbody tr').length === 1")
        other.wait_text("tarsier serve --link")
        other.complaints()
        other.close()
        token = self.token()
        self.page.click("button", "Make a new token")
        self.page.wait("document.querySelector('dialog[open]')")
        self.page.evaluate(
            "[...document.querySelectorAll('dialog[open] button')].find((one) => one.innerText === 'Make a new token').click()")
        self.page.wait_text("The new token. It is shown only once")
        self.assertNotEqual(token, self.token())
        self.page.click("tab", "Audit log")
        self.page.wait_text("other sign-ins revoked")
        self.page.wait_text("api token renewed")
        self.page.wait("document.querySelectorAll('tbody td').length > 1")
        self.check_page("system-audit", widths=(360, 1440))


class ApiTest(pages.PageTest):
    def test_endpoints(self):
        self.go("/api")
        self.page.wait("document.querySelectorAll('.endpoints details').length > 20")
        self.check_page("api")
        self.page.fill("searchbox", "Filter", "/api/sets")
        self.page.wait("document.querySelectorAll('.endpoints details').length < 12")
        self.page.evaluate("document.querySelectorAll('.endpoints details').forEach((one) => { one.open = true; })")
        shot(self.page, "api-open")

    def test_curl_examples_work(self):
        self.go("/api")
        self.page.wait("document.querySelectorAll('.endpoints details').length > 20")
        texts = self.page.evaluate("[...document.querySelectorAll('.endpoints .command code')].map((one) => one.textContent)")
        self.page.wait(f"document.querySelector('.command code').innerText.includes({self.server.workspace!r})", what="the workspace")
        settings = self.page.text(".command code")
        # Requests that need only an image. The others name a session, a job or a set of the user.
        named = ("$", "{", "-X DELETE", "FROM_THE_LINK", "holiday", "viewer-cameras", "/api/live", "/api/api-token", "/people/", "/api/state/", "/calibrate", "/v1/ar/", "/v1/plate/")
        plain = [one for one in texts
                 if not any(word in one.replace("$TARSIER_", "") for word in named) or "POST" in one and one.endswith("/api/sets")]
        self.assertGreater(len(plain), 12, texts)
        self.assertTrue(any("@" in one for one in plain), texts)
        folder = os.path.join(self.server.workspace, "calls")
        os.makedirs(folder)
        _, session = self.server.call(
            "/api/sessions", {"verb": "cartoon run", "inputs": [SMALL], "flags": {}})
        snapshot = f"/api/sessions/{session['id']}/snapshot.jpg"
        self.until("its first image is there", lambda: self.server.call(snapshot)[0] == 200)
        jpeg = self.server.call(snapshot)[1]
        for text in plain:
            for name in re.findall(r"@([\w.-]+)", text):  # images of a face
                with open(os.path.join(folder, name), "wb") as file:
                    file.write(jpeg)
            done = subprocess.run(["bash", "-c", f"{settings}; {text} -m 60 -o answer"], cwd=folder,
                                  capture_output=True, text=True, timeout=90, check=False)
            self.assertEqual(done.returncode, 0, f"{text}: {done.stderr}")

    def test_try_a_verb(self):
        self.go("/api")
        self.page.click("tab", "Try a verb")
        self.page.choose("Verb", "models list")
        self.page.click("button", "Run")
        self.page.wait("document.querySelector('pre[aria-label=Output]')?.innerText.includes('face-detector')")
        self.check_page("api-try", widths=(360, 1440))
        self.page.choose("Verb", "cartoon run")
        self.page.wait("document.querySelector('#try-inputs')")
        # Values out of range cannot be sent.
        self.page.fill("spinbutton", "Every", "0")
        self.page.wait_text("Every must be more than 0.")
        self.assertTrue(self.page.evaluate("[...document.querySelectorAll('button')].find((b) => b.innerText === 'Run').disabled"))
        shot(self.page, "api-form")


class FirstLoadTest(pages.PageTest):
    def test_policy_and_size(self):
        with urllib.request.urlopen(self.server.origin + "/", timeout=10) as answer:
            policy = answer.headers["Content-Security-Policy"]
            html = answer.read().decode()
        self.assertIn("default-src 'none'", policy)
        self.assertNotIn("unsafe", policy)
        self.assertNotIn("style=", html)
        size = 0
        for path in set(re.findall(r'(?:src|href)="(/assets/[^"]+)"', html)):
            request = urllib.request.Request(self.server.origin + path, headers={"Accept-Encoding": "gzip"})
            with urllib.request.urlopen(request, timeout=10) as answer:
                size += len(answer.read())
                self.assertIn("immutable", answer.headers["Cache-Control"])
        self.assertLess(size, 120 * 1024)


if __name__ == "__main__":
    pages.main()
