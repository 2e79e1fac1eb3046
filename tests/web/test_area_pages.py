#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The pages of the areas, and a whole path through each of them, as a user goes it: on the real server, with drawn
people, streets, boards and scenes."""

import glob
import json
import os
import re
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import pages  # noqa: E402

AREAS = ["plates", "people", "reconstruct", "annotate", "calibrate", "train", "explore"]
LONG = 240  # s, of work on a busy machine
# Every screen of every path at every width, for people who look at them: TARSIER_WEB_LOOK=1.
WIDTHS = (360, 800, 1440) if os.environ.get("TARSIER_WEB_LOOK") else (360,)


class AreaPages(pages.PageTest):
    """One server and one browser for all. Tests go in the order of their names: the empty pages first."""

    def path(self, name):
        """A page of a path is judged like all others."""
        self.judge(f"path-{name}", widths=WIDTHS)

    def started(self, verb):
        """How many jobs of a verb there will be with the next one."""
        return 1 + sum(job["verb"] == verb for job in self.server.call("/api/jobs")[1]["jobs"])

    def job_of(self, verb, timeout=LONG, at_least=1):
        """The newest job of a verb, when it is over, and so many of them are there."""
        for _ in range(timeout * 5):
            jobs = [job for job in self.server.call("/api/jobs")[1]["jobs"] if job["verb"] == verb]
            if len(jobs) >= at_least:
                job = max(jobs, key=lambda one: str(one["created"]))
                if job["state"] not in ("queued", "running"):
                    return self.server.call(f"/api/jobs/{job['id']}")[1]
            self.page.evaluate("new Promise((done) => setTimeout(done, 200))")
        self.fail(f"no job of {verb} ended in {timeout} s")

    def state(self, verb):
        """The state of the running session of a verb."""
        for one in self.server.call("/api/sessions")[1]["sessions"]:
            if one["verb"] == verb and one["running"]:
                return self.server.call(f"/api/sessions/{one['id']}")[1]
        return None

    def values(self, verb):
        """What that session says of itself; empty before its first image."""
        return (self.state(verb) or {}).get("state") or {}

    def until(self, what, condition, timeout=60):
        for _ in range(timeout * 10):
            value = condition()
            if value:
                return value
            self.page.evaluate("new Promise((done) => setTimeout(done, 100))")
        self.fail(f"not in {timeout} s: {what}\n{self.page.text('main')[:600]}")

    def test_0_each_page(self):
        for name in AREAS:
            with self.subTest(page=name):
                self.go(f"/{name}")
                self.page.find("heading", contains={"train": "Train and judge"}.get(name, name))
                self.judge(f"empty-{name}", widths=(*WIDTHS, 1440))

    def test_0_each_tab(self):
        for name, tabs in {
            "people": ["Add a person", "Who is this?", "Live"],
            "calibrate": ["2. Show it to the camera", "Or: from images"],
            "train": ["Judge"],
        }.items():
            self.go(f"/{name}")
            for tab in tabs:
                with self.subTest(page=name, tab=tab):
                    self.page.click("tab", tab)
                    self.judge(f"empty-{name}-{re.sub('[^a-z]+', '-', tab.lower()).strip('-')}", widths=WIDTHS)

    def test_reconstruct_images_to_cloud(self):
        with tempfile.TemporaryDirectory() as folder:
            scene = os.path.join(folder, "scene")
            subprocess.run(
                [os.path.join(pages.BIN, "tarsier"), "sfm", "synth", "-o", scene, "--images", "11", "--size", "480x360"],
                check=True, capture_output=True)
            paths = sorted(glob.glob(os.path.join(scene, "images", "*.jpg")))
            self.assertEqual(len(paths), 11)
            self.go("/reconstruct")
            self.page.upload(self.page.file_input(), paths)
            self.page.wait_text("11 images in ", 60)
        self.page.click("button", "Reconstruct")
        self.page.wait_text("reprojection error", LONG)
        self.assertRegex(self.page.text("main"), r"11 of 11 images, \d+ points")
        self.page.wait("Number(document.querySelector('.cloud canvas')?.dataset.drawn) > 1000", 60, "a drawn cloud")
        self.path("reconstruct")

        # By keys: the view turns, and a point is shown in its images.
        self.page.focus("application", contains="Cloud of")
        before = self.page.evaluate("document.querySelector('.cloud canvas').toDataURL().length")
        for key in ("ArrowLeft", "ArrowUp", "0"):
            self.page.press(key)
        self.assertGreater(before, 1000)
        self.page.fill("spinbutton", self.named("spinbutton", "point number"), "5")
        self.page.click("button", "Choose")
        self.page.wait_text("Point 5: seen in")
        error = float(re.search(r"(\d+\.\d+) px off", self.page.text(".point-view")).group(1))
        self.assertLess(error, 3)
        self.path("reconstruct-point")

        # Two points, a known length, and the scale.
        self.page.choose("A click on a point", "measure")
        for number in ("5", "50"):
            self.page.fill("spinbutton", self.named("spinbutton", "point number"), number)
            self.page.click("button", "Choose")
        self.page.wait_text("units of the model")
        self.page.fill("spinbutton", "It is in truth", "2.5")
        self.page.click("button", "Use as scale")
        self.page.wait_text("Distance: 2.500 m")
        self.path("reconstruct-measure")
        self.cut_box()
        self.large_cloud(self.job_of("sfm reconstruct"))

    def cut_box(self):
        """A part of the cloud, by keys and by numbers; the file has what the page counts."""
        inside = "Number(document.querySelector('.cut-box [data-inside]').dataset.inside)"
        drawn = "Number(document.querySelector('.cloud canvas').dataset.drawn)"
        every = self.page.evaluate(drawn)
        self.page.click("checkbox", "Cut box")
        self.page.wait("document.querySelector('.cut-box')")
        first = self.page.evaluate(inside)
        self.assertTrue(0 < first < every, first)
        self.page.evaluate("document.querySelector('[data-face=x-low]').focus()")
        for _ in range(20):
            self.page.press("ArrowRight")
        self.page.wait(f"{inside} < {first}", what="fewer points")
        # The scale of before makes them metres.
        self.page.evaluate("""(() => { const one = document.querySelector('[data-number=y-high]');
          one.value = String(Number(document.querySelector('[data-number=y-low]').value) - 1);
          one.dispatchEvent(new Event('change', {bubbles: true})); })()""")
        self.page.wait("document.querySelector('[data-number=y-high]').value === document.querySelector('[data-number=y-low]').value",
                       what="faces do not pass each other")
        self.page.click("button", "The whole cloud")
        self.page.wait(f"{inside} === {every}")
        self.drag_box(inside, every)
        self.page.click("button", "The whole cloud")
        self.page.wait(f"{inside} === {every}")
        self.page.evaluate("document.querySelector('[data-face=z-high]').focus()")
        for _ in range(30):
            self.page.press("ArrowLeft")
        self.page.wait(f"{inside} < {every}")
        left = self.page.evaluate(inside)
        self.page.click("checkbox", "Show the points in the box alone")
        self.page.wait(f"{drawn} === {left}", what="the points in the box alone")
        folder = os.path.join(self.server.workspace, "downloads")
        os.makedirs(folder, exist_ok=True)
        self.browser.send("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": folder, "browserContextId": self.context})
        self.page.click("button", "Download the points in the box (PLY)")
        name = os.path.join(folder, "points-in-box.ply")
        self.until("the file", lambda: os.path.exists(name) and os.path.getsize(name) > 100)
        with open(name, "rb") as file:
            self.assertIn(f"element vertex {left}\n".encode(), file.read(400))
        self.path("reconstruct-cut")

    def drag_box(self, inside, every):
        """A face of the cut box, dragged by its handle in the image, then moved by keys."""
        self.page.evaluate("document.querySelector('.cloud canvas').scrollIntoView({block: 'center'})")
        self.page.focus("application", contains="Cloud of")
        self.page.press("0")
        self.page.wait("JSON.parse(document.querySelector('.cloud canvas').dataset.handles)['x-high']", what="handles")
        self.page.evaluate("new Promise((done) => setTimeout(done, 400))")  # the view comes to rest
        place = """(() => { const canvas = document.querySelector('.cloud canvas'), box = canvas.getBoundingClientRect();
          const at = JSON.parse(canvas.dataset.handles); const to = (name) => [box.left + at[name][0], box.top + at[name][1]];
          return {high: to('x-high'), low: to('x-low')}; })()"""
        before = self.page.evaluate(place)
        value = "Number(document.querySelector('[data-face=x-high]').value)"
        first = self.page.evaluate(value)
        (x0, y0), (x1, y1) = before["high"], before["low"]
        self.page.drag((x0, y0), (x0 + 0.3 * (x1 - x0), y0 + 0.3 * (y1 - y0)))
        self.page.wait(f"{value} < {first}", what="the dragged face")
        self.page.wait(f"0 < {inside} && {inside} < {every}")

        def is_there():
            after = self.page.evaluate(place)
            return (abs(after["high"][0] - (x0 + 0.3 * (x1 - x0))) + abs(after["high"][1] - (y0 + 0.3 * (y1 - y0))) < 6
                    and abs(after["low"][0] - x1) + abs(after["low"][1] - y1) < 3)

        self.until("the handle is where it was dropped, and the view has not turned", is_there, 10)
        self.assertEqual(self.page.evaluate("document.querySelector('[data-chosen]').dataset.chosen"), "x-high")
        self.path("reconstruct-drag")
        self.page.evaluate("document.querySelector('.cloud canvas').scrollIntoView({block: 'center'})")
        self.page.focus("application", contains="Cloud of")
        dragged = self.page.evaluate(value)
        self.page.press(",")
        self.page.wait(f"{value} < {dragged}", what="a face moved by a key")
        top = "Number(document.querySelector('[data-face=y-high]').value)"
        height = self.page.evaluate(top)
        for key in ("y", ",", ","):
            self.page.press(key)
        self.page.wait(f"{top} < {height}", what="another face moved by keys")
        self.page.press("Escape")
        self.page.wait("document.querySelector('[data-chosen]').dataset.chosen === ''")
        self.assertTrue(self.page.has("application", contains="Cloud of"), "Escape lets go of the face alone")

    def test_reconstruct_drawn_and_cancel(self):
        self.go("/reconstruct")
        self.page.choose("Synthetic images", "11")
        self.page.click("button", "Try with synthetic data")
        self.page.click("button", "Cancel", timeout=120)
        job = self.job_of("sfm reconstruct")
        self.assertEqual(job["state"], "cancelled")
        self.page.wait_text("cancelled")

    def test_reconstruct_watch_it_grow(self):
        """The model grows before the viewer's eyes."""
        with tempfile.TemporaryDirectory() as folder:
            scene = os.path.join(folder, "scene")
            subprocess.run(
                [os.path.join(pages.BIN, "tarsier"), "sfm", "synth", "-o", scene, "--images", "8", "--size", "480x360",
                 "--trajectory", "line"], check=True, capture_output=True)
            self.go("/reconstruct")
            self.page.upload(self.page.file_input(), sorted(glob.glob(os.path.join(scene, "images", "*.jpg"))))
            self.page.wait_text("8 images in ", 60)
        self.page.click("button", "Watch it grow")
        self.page.wait("document.querySelector('.live-view:not(.is-waiting) canvas')", 60, "a live image")
        growing = self.state("sfm reconstruct")["id"]

        def stages():
            status, record = self.server.call(f"/api/sessions/{growing}/stages")
            return status == 200 and b'"name":"features"' in record

        self.until("the stages of a frame", stages, 20)
        self.page.wait("/[1-9][0-9]* points/.test(document.querySelector('.live-status')?.innerText)", 60, "points")
        self.path("reconstruct-growing")
        self.page.click("button", "End" if self.page.has("button", "End") else "Close")

    def large_cloud(self, job):
        """A cloud of 100 000 points is read beside the page and turns in software rendering."""
        points = os.path.join(self.server.workspace, "jobs", job["id"], "files", "model", "points3D.txt")
        with open(points, encoding="utf-8") as file:
            lines = [line.split() for line in file if not line.startswith("#")]
        with open(points, "w", encoding="utf-8") as file:
            for n in range(100_000):
                line = lines[n % len(lines)]
                place = [f"{float(value) + 0.02 * ((n * 37 + k * 11) % 101 - 50) / 50:.5f}" for k, value in enumerate(line[1:4])]
                file.write(" ".join([str(n + 1), *place, *line[4:]]) + "\n")
        self.go(f"/reconstruct?job={job['id']}")
        self.page.wait("Number(document.querySelector('.cloud canvas')?.dataset.drawn) === 100000", 60, "all points")
        box = self.page.evaluate("(() => { const b = document.querySelector('.cloud canvas').getBoundingClientRect();"
                                 " return [b.left + b.width / 2, b.top + b.height / 2]; })()")
        self.page.drag(box, (box[0] + 160, box[1] + 40), steps=30)
        moving = self.page.evaluate("(() => ({...document.querySelector('.cloud canvas').dataset}))()")
        print(f"100 000 points: {moving['ms']} ms a frame while it turns, {moving['drawn']} points of it drawn")
        self.assertLess(float(moving["ms"]), 500)
        self.page.wait("Number(document.querySelector('.cloud canvas').dataset.drawn) === 100000", 20, "all points at rest")

    def named(self, role, part):
        return next(name for _, name, _ in self.page.find_all(role) if part in name)

    def enrol(self, name):
        self.page.click("tab", "Add a person")
        self.page.click("button", contains=name, timeout=LONG)
        self.page.click("button", "Enrol", timeout=LONG)
        self.page.wait_text("images were taken", LONG)
        taken, shots = map(int, re.search(r"(\d+) of (\d+) images were taken", self.page.text("main")).groups())
        self.assertEqual(shots, 10)
        self.assertGreaterEqual(taken, 3)

    def test_people_enrol_recognise_forget(self):
        self.go("/people")
        self.enrol("Ann (synthetic)")
        self.path("people-enrolled")
        self.page.click("button", "Add another person")
        self.enrol("Ben (synthetic)")
        self.page.click("button", "Try it: who is this?")
        seen = set()
        for _ in range(6):
            before = self.page.text(".boxed + *, section[aria-label='Who is on it']")
            self.page.click("button", "Try with synthetic data")
            self.page.wait(
                "document.querySelector('section[aria-label=\"Who is on it\"]')?.innerText && "
                f"document.querySelector('section[aria-label=\"Who is on it\"]').innerText !== {json.dumps(before)} && "
                "!document.querySelector('.is-busy')", 60, "an answer")
            seen.update(re.findall(r"Ann \(synthetic\)|Ben \(synthetic\)", self.page.text("section[aria-label='Who is on it'] h2")))
        self.assertEqual(seen, {"Ann (synthetic)", "Ben (synthetic)"})
        self.path("people-recognised")

        self.page.click("tab", "Gallery")
        self.page.find("button", "Forget Ann (synthetic)")
        self.path("people-gallery")
        self.page.click("button", "Forget Ann (synthetic)")
        self.page.click("button", "Forget")
        self.page.wait_text("Pieces that were looked for", 60)
        self.assertIn("None of them is left", self.page.text("dialog[open]"))
        pages.shot(self.page, "path-people-forgotten")
        self.page.click("button", "Close")
        self.page.wait("!document.body.innerText.includes('Forget Ann')")

    def groups_there(self, count):
        self.page.wait("[...document.querySelectorAll('button')].filter((one) => "
                       f"one.getAttribute('aria-label')?.startsWith('Name group')).length === {count}", 30, f"{count} groups")

    def test_people_groups_named_merged_corrected(self):
        """Unknown faces: grouped, named, merged, "not this person", and each taken back."""
        status, job = self.server.call("/api/jobs", {
            "verb": "pose synth", "flags": {"--output": "out:strangers", "--count": 3, "--seed": 1, "--size": "320x240",
                                            "--near": 450, "--far": 500}})
        self.assertEqual(status, 201, job)
        self.job_of("pose synth", at_least=self.started("pose synth") - 1)
        images = [f"job:{job['id']}/strangers/images/{k:04}.png" for k in (0, 1, 2, 0, 1, 2)]
        for image in images:
            answer = self.server.call("/api/run", {"verb": "people identify", "inputs": [image],
                                                   "flags": {"--keep": "30d", "--far": 0.000001}})[1]
            self.assertIn(answer["exit"], (0, 1), answer)
        self.go("/people")
        self.page.click("button", "Group unknown faces")
        self.page.find("button", contains="Name group", timeout=60)
        self.page.click("button", "Show the faces")
        self.page.wait("document.querySelector('img.sheet')?.naturalWidth > 100", 60, "the sheet")
        self.assertEqual([one for one in self.server.call("/api/jobs")[1]["jobs"] if one["verb"] == "people groups"], [])
        self.path("people-groups")
        buttons = [name for _, name, _ in self.page.find_all("button") if name.startswith("Name group")]
        self.assertEqual(len(buttons), 3)

        name = "Zoe <img src=x onerror=alert(1)>"
        self.page.click("button", buttons[0])
        self.page.fill("textbox", "Name", name)
        self.path("people-groups-name")
        self.page.click("button", "Enrol")
        self.page.wait_text(f"is {name}")
        self.assertEqual(self.page.evaluate("document.querySelectorAll('img[src=x]').length"), 0)
        self.groups_there(2)
        self.page.click("button", buttons[1])
        self.page.click("button", "Merge")
        self.page.wait_text("is part of group")
        self.groups_there(1)
        wrong = next(name for _, name, _ in self.page.find_all("button") if name.startswith("Not this person"))
        self.page.click("button", wrong)
        self.page.wait_text(f"not {name}")
        self.path("people-corrected")
        for _ in range(3):
            undo = next(name for _, name, _ in self.page.find_all("button") if name.startswith("Undo correction"))
            self.page.click("button", undo)
            self.page.wait(f"!document.querySelector('[aria-label={json.dumps(undo)}]')", 30, "taken back")
        self.groups_there(3)

    def test_people_name_with_markup_stays_text(self):
        self.go("/people")
        self.page.click("tab", "Add a person")
        name = "<img src=x onerror=alert(1)>"
        self.page.fill("textbox", "Name", name)
        self.page.fill("textbox", "What was agreed", "<b>yes</b>")
        self.page.click("checkbox", "This person has agreed")
        self.page.click("button", "Next: images")
        self.page.wait_text(f"Images of {name}")
        self.assertEqual(self.page.evaluate("document.querySelectorAll('img[src=x]').length"), 0)

    def test_people_live(self):
        self.go("/people")
        self.page.click("tab", "Live")
        self.page.click("button", "Start")
        self.page.wait("document.querySelector('.live-view:not(.is-waiting) canvas')", 60, "a live image")
        self.path("people-live")
        self.page.click("button", "End")
        self.page.find("button", "Start")

    KEEP = [36, 39, 42, 45, 30, 48, 54, 33]  # of the 68 points of the truth
    MIRROR = [(0, 3), (1, 2), (5, 6), (4, 4), (7, 7)]

    def truth(self):
        files = glob.glob(os.path.join(self.server.workspace, "jobs", "*", "files", "heads", "truth.jsonl"))
        self.assertTrue(files)
        with open(max(files, key=os.path.getmtime), encoding="utf-8") as file:
            lines = [json.loads(line) for line in file]
        return {os.path.basename(one["image"]): [one["points"][i] for i in self.KEEP] for one in lines}

    def click_image(self, x, y):
        """A click at a pixel of the image."""
        session = self.state("landmarks annotate")
        x0, y0, scale = session["state"]["view"]
        box = self.page.evaluate("""(() => { const c = document.querySelector('.annotate-image canvas');
          c.scrollIntoView({block: 'center'}); const b = c.getBoundingClientRect();
          return [b.left, b.top, b.width, b.height]; })()""")
        vx, vy = x0 + scale * x, y0 + scale * y
        self.page.click_at(box[0] + (vx + 0.5) * box[2] / session["width"], box[1] + (vy + 0.5) * box[3] / session["height"])

    def at(self, name, value, timeout=30):
        self.until(f"{name} is {value}",
                   lambda: self.values("landmarks annotate").get(name) == value, timeout)

    def test_annotate_train_judge(self):
        self.go("/annotate")
        self.page.click("button", "Try with synthetic data")
        self.page.wait("document.querySelector('.annotate-image .live-view:not(.is-waiting) canvas')", LONG, "the image")
        self.at("images", 5)
        truth = self.truth()
        points = truth[os.path.basename(self.state("landmarks annotate")["state"]["path"])]
        for n, (x, y) in enumerate(points[:7]):
            self.click_image(x, y)
            self.at("points", n + 1)
        # One click is taken back and comes again.
        self.page.click("button", "Undo")
        self.at("points", 6)
        self.page.click("button", "Redo")
        self.at("points", 7)
        # The last point by keys alone: the cross is moved to it, Enter clicks.
        session = self.state("landmarks annotate")
        x0, y0, scale = session["state"]["view"]
        self.page.focus("application", contains="Cross at")
        want = (x0 + scale * points[7][0], y0 + scale * points[7][1])
        at = self.page.evaluate("document.querySelector('.pad').innerText.match(/[0-9]+/g).map(Number)")
        for axis, keys in ((0, ("ArrowLeft", "ArrowRight")), (1, ("ArrowUp", "ArrowDown"))):
            way = want[axis] - at[axis]
            for _ in range(int(abs(way) // 20)):
                self.page.press(keys[way > 0], shift=True)
            for _ in range(round((abs(way) % 20) / 2)):
                self.page.press(keys[way > 0])
        self.page.press("Enter")
        self.at("points", 8)
        self.path("annotate-points")

        # The kill of the program loses nothing: the journal has every click.
        self.page.click("button", "Mirror images")
        self.at("stage", "symmetry")
        for a, b in self.MIRROR:
            self.click_image(*points[a])
            self.click_image(*points[b])
        self.page.click("button", "All images")
        self.at("stage", "images")
        for _ in range(6):
            state = self.state("landmarks annotate")["state"]
            if state["done"] == 5:
                break
            self.until("it has learnt", lambda: not self.state("landmarks annotate")["state"]["learning"])
            state = self.state("landmarks annotate")["state"]
            if state["image"] > 0 and not state["agreed"]:
                self.drag_points(truth[os.path.basename(state["path"])])
            self.page.click("button", "It is right, go on")
            self.until("the next image", lambda: (lambda now: now["image"] != state["image"] or now["done"] != state["done"])(
                self.state("landmarks annotate")["state"]))
        self.at("done", 5)
        self.path("annotate-images")
        self.page.click("button", "Save and end")
        self.page.wait_text("Saved as", 60)
        self.path("annotate-saved")

        self.page.click("link", "Train with it")
        self.page.wait("document.querySelector('main[data-page=train][data-ready=yes]')")
        self.page.click("button", "Train", timeout=60)
        self.page.click("button", "Judge it", timeout=LONG)
        self.page.find("button", "Judge")
        self.page.fill("textbox", "Eyes", "0 3")
        self.page.choose("Compare", "no")
        self.page.click("button", "Judge")
        self.page.wait_text("Worst cases first", LONG)
        self.page.wait("document.querySelectorAll('.found').length >= 8", 60, "points on the worst image")
        self.assertIn("Mean error", self.page.text("main"))
        self.path("train-worst")

    def drag_points(self, truth):
        """Proposals that are off are dragged to where they belong, by their places if the session tells them."""
        session = self.state("landmarks annotate")
        places = session["state"].get("places")
        if not places:
            return
        box = self.page.evaluate("""(() => { const c = document.querySelector('.annotate-image canvas');
          c.scrollIntoView({block: 'center'}); const b = c.getBoundingClientRect();
          return [b.left, b.top, b.width, b.height]; })()""")
        x0, y0, scale = session["state"]["view"]

        def shown(point):
            return (box[0] + (x0 + scale * point[0] + 0.5) * box[2] / session["width"],
                    box[1] + (y0 + scale * point[1] + 0.5) * box[3] / session["height"])
        for n, place in enumerate(places):
            if place and max(abs(place[0] - truth[n][0]), abs(place[1] - truth[n][1])) > 2:
                self.page.drag(shown(place), shown(truth[n]))

    def test_train_and_compare(self):
        self.go("/train")
        self.page.choose("Model", "3")  # the appearance model: seconds
        self.page.click("button", "Try with synthetic data")
        self.page.wait("[...document.querySelectorAll('main select')].some((one) => one.value.endsWith('heads/set.json'))",
                       LONG, "drawn heads")
        self.page.fill("spinbutton", "Hold out", "3")
        self.page.click("button", "Train")
        self.page.click("button", "Judge it", timeout=LONG)
        self.page.fill("spinbutton", "Held out", "3")
        self.page.click("button", "Judge")
        self.page.wait_text("Worst cases first", LONG)
        self.assertEqual(
            self.page.evaluate("[...document.querySelectorAll('main table')[0].tHead.rows[0].cells].map((one) => one.innerText)"),
            ["What", "Mine", "What ships", "Better"])
        self.path("train-compare")

        # The new model takes the place of the one that ships, for what starts from now on.
        self.page.wait_text("Of ")
        self.page.click("button", "Install")
        self.page.click("button", "Install it")
        self.page.wait_text("Installed as aam68", 60)
        self.path("train-installed")
        own = os.path.join(self.server.workspace, "models", "aam68.json")
        self.assertTrue(os.path.getsize(own) > 1000)
        fit = {"verb": "aam fit", "inputs": ["synth:portrait?frames=1"], "flags": {"-o": "none"}}
        self.assertEqual(self.server.call("/api/run", fit)[1]["exit"], 0)
        kept = os.path.join(self.server.workspace, "kept.json")
        os.rename(own, kept)
        with open(own, "w", encoding="utf-8") as file:
            file.write("{}")
        status, answer = self.server.call("/api/run", fit)
        self.assertEqual((status, answer["exit"]), (500, 5), "a run takes the model that is installed")
        status, session = self.server.call("/api/sessions", {"verb": "aam fit", "inputs": ["synth:portrait?live=1"]})
        self.until("the session falls over it, too", lambda: self.server.call(f"/api/sessions/{session['id']}")[1]["exit"] == 5)
        os.rename(kept, own)
        # A file that is no such model is refused, and leaves what is installed.
        reference = [one for one in self.server.call("/api/jobs")[1]["jobs"] if one["verb"] == "pose synth"][0]["id"]
        answer = self.server.call("/api/run", {"verb": "models install", "inputs": [f"job:{reference}/heads/set.json"]})[1]
        self.assertEqual(answer["exit"], 5, answer)
        self.assertEqual(self.server.call("/api/run", {"verb": "models install", "inputs": ["/etc/passwd"]})[0], 400)
        self.assertEqual(self.server.call("/api/run", {"verb": "models install", "inputs": ["model:head"], "flags": {"--own-dir": "/tmp"}})[0], 400)

        self.go("/system")
        self.page.click("tab", "Models")
        self.page.wait_text("your own", 60)
        self.path("system-own-model")
        self.page.click("button", "Back to what ships for aam68")
        self.page.click("button", "Remove my model")
        self.page.wait("!document.querySelector('main').innerText.includes('your own')", 60, "what ships again")
        self.assertFalse(os.path.exists(own))
        events = [one["event"] for one in self.server.call("/api/audit")[1]["lines"]]
        self.assertIn("model install", events)
        self.assertIn("model remove", events)

    def test_calibrate_print_show_keep(self):
        self.go("/calibrate")
        self.page.click("button", "Make the sheet")
        self.page.wait_text("Download board.pdf", 60)
        status, sheet = self.server.call(f"/api/jobs/{self.job_of('ar marker-sheet')['id']}/files/board.pdf")
        self.assertEqual(status, 200)
        self.assertTrue(sheet.startswith(b"%PDF"))
        self.path("calibrate-print")

        self.page.click("button", "I have one: go on")
        self.page.click("button", "Try with synthetic data")
        self.until("the camera is calibrated", lambda: self.values("calibrate").get("calibrated"), LONG)
        self.path("calibrate-live")
        self.page.click("button", "Finish and keep the camera")
        self.page.wait_text("The camera is kept as", 60)
        self.page.wait_text("distortion:")
        status, camera = self.server.call("/api/state/camera.yaml")
        self.assertEqual(status, 200)
        self.assertIn(b"fx:", camera)
        self.path("calibrate-kept")

    def test_calibrate_from_images(self):
        self.go("/calibrate")
        self.page.click("tab", "Or: from images")
        self.page.click("button", "Try with synthetic data")
        self.page.wait_text("The camera in numbers", LONG)
        self.assertRegex(self.page.text("main"), r"Error 0\.\d+ px, \d+ of \d+ images used")
        self.page.wait_text("Views, largest error first")
        self.path("calibrate-photos")

    def count(self):
        found = re.search(r"(\d+) events?", self.page.text("main p[role=status]"))
        return int(found.group(1)) if found else -1

    def texts(self):
        return self.page.evaluate("[...document.querySelectorAll('.plate-text')].map((one) => one.innerText)")

    def stored(self):
        answer = self.server.call("/api/run", {"verb": "plate log", "inputs": ["ws:plates.db"], "flags": {}})[1]
        return len(answer["lines"])

    def test_plates_a_day(self):
        self.go("/plates")
        self.page.click("button", "Try with synthetic data")
        self.page.wait("document.querySelector('main progress')")
        self.page.wait("!document.querySelector('main progress')", LONG, "the end of the day")
        self.until("the events of the day", lambda: self.count() >= 10 and self.count() == self.stored(), 60)
        every = self.count()
        self.page.wait("document.querySelectorAll('.plate img').length > 3", 60, "images of plates")
        self.path("plates-day")

        text = self.page.text(".plate-text")
        self.assertRegex(text, r"^[A-Z0-9]{4,}$")
        self.page.fill("searchbox", "Text of the plate", text[1:4])
        self.page.click("button", "Search")
        self.page.wait("document.querySelector('main p[role=status]').innerText.endsWith('found')", 30, "what was found")
        self.assertLess(self.count(), every)
        self.assertIn(text, self.texts())
        wrong = ("X" if text[0] != "X" else "Y") + text[1:]
        self.page.fill("searchbox", "Text of the plate", wrong)
        self.page.click("checkbox", "Nearly this text")
        self.page.click("button", "Search")
        self.until("the near text", lambda: text in self.texts())
        self.page.click("button", "Show all")
        self.page.choose("When", "12h")
        self.page.click("button", "Search")
        self.until("fewer in the last 12 hours", lambda: 0 < self.count() < every)
        self.path("plates-search")

        self.page.click("button", f"More about {text}")
        self.page.wait_text("How sure of each character", 60)
        pages.shot(self.page, "path-plates-detail")
        self.page.fill("textbox", "What the plate really says", "ABC 123")
        self.page.click("button", "Correct")
        self.page.wait_text("read as", 30)
        lines = self.server.call("/api/run", {"verb": "plate log", "inputs": ["ws:plates.db"], "flags": {"--text": "ABC123"}})[1]["lines"]
        self.assertEqual([(one["text"], one["correction"]["text"]) for one in lines], [(text, "ABC123")])
        self.path("plates-corrected")
        self.page.click("button", "Make training data")
        self.page.wait_text("1 corrected plates are in the job", 60)
        self.page.click("button", "More about ABC123")
        self.page.click("button", self.undo_button())
        self.until("the text as it was read", lambda: "ABC123" not in self.texts())

    def undo_button(self):
        self.page.wait_text("Take the correction of", 30)
        return next(one[1] for one in self.page.find_all("button") if one[1].startswith("Take the correction of"))

    def test_plates_that_matter(self):
        self.go("/plates")
        self.page.fill("textbox", "Watch for", "b-12?4*")
        self.page.fill("textbox", "Whose it is", "Ann")
        self.page.fill("textbox", "Hours", "06:00-22:00")
        self.page.click("button", "Watch")
        self.page.wait_text("06:00-22:00", 30)
        with open(os.path.join(self.server.workspace, "watch.csv")) as file:
            self.assertIn("B12?4*,Ann,0.25,,06:00-22:00,", file.read())
        self.path("plates-watch")
        self.page.fill("textbox", "Watch for", "2863SDN")
        self.page.fill("textbox", "Hours", "8-9")
        self.page.wait_text("From and to, like 08:00-18:00", 30)
        self.page.click("button", "Remove B12?4*")
        self.until("an empty list", lambda: not [one for one in self.page.find_all("button") if one[1].startswith("Remove B12")])

    def test_plates_live(self):
        self.go("/plates")
        self.page.click("button", "Start reading")
        self.page.wait("document.querySelector('.live-view:not(.is-waiting) canvas')", 60, "a live image")
        self.path("plates-live")
        self.page.click("button", "Stop reading")
        self.page.find("button", "Start reading")

    def test_explore_sliders(self):
        self.go("/explore")
        self.page.click("button", "Try with synthetic data")
        self.page.wait("document.querySelector('.live-view:not(.is-waiting) canvas')", 60, "a face")
        name = self.until("sliders", lambda: [one[1] for one in self.page.find_all("slider")])[0]
        self.page.slide(name, 2)
        self.until("the face has changed", lambda: any(
            abs(value) > 1.5 for value in self.values("aam explore").get("shape", [])))
        # All modes have a slider, the further ones on request.
        every = len(self.server.call(f"/api/sessions/{self.state('aam explore')['id']}")[1]["sliders"])
        self.assertGreater(every, 8)
        self.assertEqual(len(self.page.find_all("slider")), 8)
        for kind in ("shape", "look"):
            self.page.click("button", contains=f"modes of {kind}")
        self.until("a slider for each mode", lambda: len(self.page.find_all("slider")) == every)
        self.page.slide("Look 7", -2)
        self.until("the look has changed", lambda: self.values("aam explore").get("look", [0] * 7)[6] < -1.5)
        self.path("explore-all")
        self.page.click("button", "Look to the middle")
        self.until("the look is the mean", lambda: not any(self.values("aam explore").get("look", [1])))
        self.page.click("button", contains="random")
        self.path("explore")
        self.page.click("button", "End")
        self.page.choose("Model of", "points")
        self.page.click("button", "Explore")
        self.page.wait("document.querySelector('.live-view:not(.is-waiting) canvas')", 60, "a patch")
        self.path("explore-points")
        self.page.click("button", "End")


if __name__ == "__main__":
    pages.main()
