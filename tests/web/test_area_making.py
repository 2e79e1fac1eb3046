#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Complete workflows through the pages that make results from images: a reconstruction, annotations, a trained model, a
calibrated camera. On the real server, with synthetic scenes, people and boards."""

import glob
import json
import os
import re
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import pages  # noqa: E402
from area_page import AreaPageTest, LONG, long  # noqa: E402


class AreaMaking(AreaPageTest):
    def test_reconstruct_images_to_cloud(self):
        with tempfile.TemporaryDirectory() as folder:
            scene = os.path.join(folder, "scene")
            subprocess.run(
                [os.path.join(pages.BIN, "tarsier"), "sfm", "synth", "-o", scene, "--images", "9", "--size", "288x216"],
                check=True, capture_output=True)
            paths = sorted(glob.glob(os.path.join(scene, "images", "*.jpg")))
            self.assertEqual(len(paths), 9)
            self.go("/reconstruct")
            self.page.upload(self.page.file_input(), paths)
            self.page.wait_text("9 images in ")
        self.page.choose("Result", "surface")
        self.page.choose("Detail", "draft")
        self.page.click("button", "Reconstruct")
        self.page.wait_text("reprojection error", LONG)
        self.assertRegex(self.page.text("main"), r"9 of 9 images, \d+ points")
        self.page.wait("Number(document.querySelector('.cloud canvas')?.dataset.drawn) > 1000", 60, "a drawn cloud")
        self.path("reconstruct")

        # By keys: the view rotates, and a point is shown in its images.
        self.page.focus("application", contains="Cloud of")
        before = self.page.evaluate("document.querySelector('.cloud canvas').toDataURL().length")
        for key in ("ArrowLeft", "ArrowUp", "0"):
            self.page.press(key)
        self.assertGreater(before, 1000)
        self.page.fill("spinbutton", self.named("spinbutton", "point number"), "5")
        self.page.click("button", "Choose")
        self.page.wait_text("Point 5: observed in")
        error = float(re.search(r"error (\d+\.\d+) px", self.page.text(".point-view")).group(1))
        self.assertLess(error, 3)
        self.path("reconstruct-point")

        # Two points, a known length, and the scale.
        self.page.choose("A click on a point", "measure")
        for number in ("5", "50"):
            self.page.fill("spinbutton", self.named("spinbutton", "point number"), number)
            self.page.click("button", "Choose")
        self.page.wait_text("units of the model")
        self.page.fill("spinbutton", "Real distance", "2.5")
        self.page.click("button", "Set the scale")
        self.page.wait_text("Distance: 2.500 m")
        self.path("reconstruct-measure")
        self.cut_box()
        job = self.job_of("sfm reconstruct")
        self.dense_and_surface(job)
        self.large_cloud(job)

    def measure_by_clicks(self):
        """Two clicks, left and right of the middle, measure a distance."""
        self.page.evaluate("document.querySelector('.cloud canvas').scrollIntoView({block: 'center'})")
        left, top, width, height = self.page.evaluate(
            "(() => { const b = document.querySelector('.cloud canvas').getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; })()")
        for across in (0.45, 0.55):
            self.page.click_at(left + across * width, top + 0.5 * height)
        self.page.wait_text("Distance: ")
        return float(re.search(r"Distance: ([\d.]+) m", self.page.text(".cloud")).group(1))

    def dense_and_surface(self, job):
        """The dense cloud and the surface of the same job, in the same view, cropped and measured like the points."""
        shown = "document.querySelector('.cloud canvas').dataset.shown"
        drawn = "Number(document.querySelector('.cloud canvas').dataset.drawn)"
        points = int(re.search(r"(\d+) points, each observed", self.page.text("main")).group(1))
        self.page.choose("Show", "dense")
        self.page.wait(f"{shown} === 'dense'", 60, "the dense cloud")
        inside = "Number(document.querySelector('.cut-box [data-inside]').dataset.inside)"
        self.page.wait(f"{drawn} === {inside}", 20, "the part of it in the box")
        self.page.click("button", "Reset the box")
        self.page.click("checkbox", "Cut box")
        self.page.wait(f"{drawn} > 10 * {points}", 20, "all of it")
        wide = self.measure_by_clicks()
        self.path("reconstruct-dense")
        self.page.choose("Show", "surface")
        self.page.wait(f"{shown} === 'surface' && document.querySelector('.cloud canvas').dataset.texture", 60, "the surface")
        self.page.wait_text("Triangles")
        self.assertTrue(0.7 < self.measure_by_clicks() / wide < 1.4, "the surface lies where the cloud does")
        self.path("reconstruct-surface")
        self.page.click("checkbox", "Cut box")
        self.path("reconstruct-surface-cut")
        self.page.click("checkbox", "Cut box")
        names = [file["name"] for file in job["files"]]
        links = self.page.evaluate("[...document.querySelectorAll('main .file-list a')].map((one) => one.textContent)")
        self.assertTrue({"model/mesh.glb", "model/dense/fused.ply", "model/points.ply"} <= set(links), links)
        self.assertLess(len(links), len(names), "depth maps are not offered one by one")
        status, glb = self.server.call(f"/api/jobs/{job['id']}/files/model/mesh.glb")
        self.assertEqual((status, glb[:4]), (200, b"glTF"))

    def cut_box(self):
        """Part of the cloud, chosen by keys and by numbers. The file has the number of points that the page shows."""
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
        # The scale set before makes them metres.
        self.page.evaluate("""(() => { const one = document.querySelector('[data-number=y-high]');
          one.value = String(Number(document.querySelector('[data-number=y-low]').value) - 1);
          one.dispatchEvent(new Event('change', {bubbles: true})); })()""")
        self.page.wait("document.querySelector('[data-number=y-high]').value === document.querySelector('[data-number=y-low]').value",
                       what="faces do not pass each other")
        self.page.click("button", "Reset the box")
        self.page.wait(f"{inside} === {every}")
        self.drag_box(inside, every)
        self.page.click("button", "Reset the box")
        self.page.wait(f"{inside} === {every}")
        self.page.evaluate("document.querySelector('[data-face=z-high]').focus()")
        for _ in range(30):
            self.page.press("ArrowLeft")
        self.page.wait(f"{inside} < {every}")
        left = self.page.evaluate(inside)
        self.page.click("checkbox", "Show only the points in the box")
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
        """Drags a face of the crop box by its handle in the image, then moves it by keys."""
        self.page.evaluate("document.querySelector('.cloud canvas').scrollIntoView({block: 'center'})")
        self.page.focus("application", contains="Cloud of")
        self.page.press("0")
        self.page.wait("JSON.parse(document.querySelector('.cloud canvas').dataset.handles)['x-high']", what="handles")
        self.page.evaluate("new Promise((done) => setTimeout(done, 400))")  # until the view rests
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

        self.until("the handle is where it was dropped, and the view has not turned", is_there)
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

    def test_reconstruct_cancel_synthetic(self):
        self.go("/reconstruct")
        self.page.choose("Synthetic images", "11")
        self.page.click("button", "Try with synthetic data")
        self.page.click("button", "Cancel")
        job = self.job_of("sfm reconstruct")
        self.assertEqual(job["state"], "cancelled")
        self.page.wait_text("cancelled")

    @long
    def test_reconstruct_online(self):
        """The model grows while it is viewed."""
        with tempfile.TemporaryDirectory() as folder:
            scene = os.path.join(folder, "scene")
            subprocess.run(
                [os.path.join(pages.BIN, "tarsier"), "sfm", "synth", "-o", scene, "--images", "8", "--size", "480x360",
                 "--trajectory", "line"], check=True, capture_output=True)
            self.go("/reconstruct")
            self.page.upload(self.page.file_input(), sorted(glob.glob(os.path.join(scene, "images", "*.jpg"))))
            self.page.wait_text("8 images in ")
        self.page.click("button", "Reconstruct live")
        self.page.wait("document.querySelector('.live-view:not(.is-waiting) canvas')", 60, "a live image")
        growing = self.state("sfm reconstruct")["id"]

        def stages():
            status, record = self.server.call(f"/api/sessions/{growing}/stages")
            return status == 200 and b'"name":"features"' in record

        self.until("the stages of a frame", stages)
        self.page.wait("/[1-9][0-9]* points/.test(document.querySelector('.live-status')?.innerText)", 60, "points")
        self.path("reconstruct-growing")
        self.page.click("button", "End" if self.page.has("button", "End") else "Close")

    def large_cloud(self, job):
        """A cloud of 100 000 points is loaded beside the page and rotates in software rendering."""
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

    KEEP = [36, 39, 42, 45, 30, 48, 54, 33]  # of the 68 points of the ground truth

    MIRROR = [(0, 3), (1, 2), (5, 6), (4, 4), (7, 7)]

    def truth(self):
        files = glob.glob(os.path.join(self.server.workspace, "jobs", "*", "files", "heads", "truth.jsonl"))
        self.assertTrue(files)
        with open(max(files, key=os.path.getmtime), encoding="utf-8") as file:
            lines = [json.loads(line) for line in file]
        return {os.path.basename(one["image"]): [one["points"][i] for i in self.KEEP] for one in lines}

    def click_image(self, x, y):
        """Clicks a pixel of the image."""
        session = self.state("landmarks annotate")
        x0, y0, scale = session["state"]["view"]
        box = self.page.evaluate("""(() => { const c = document.querySelector('.annotate-image canvas');
          c.scrollIntoView({block: 'center'}); const b = c.getBoundingClientRect();
          return [b.left, b.top, b.width, b.height]; })()""")
        vx, vy = x0 + scale * x, y0 + scale * y
        self.page.click_at(box[0] + (vx + 0.5) * box[2] / session["width"], box[1] + (vy + 0.5) * box[3] / session["height"])

    def at(self, name, value):
        self.until(f"{name} is {value}",
                   lambda: self.values("landmarks annotate").get(name) == value)

    def test_annotate_train_evaluate(self):
        self.go("/annotate")
        self.page.click("button", "Try with synthetic data")
        self.page.wait("document.querySelector('.annotate-image .live-view:not(.is-waiting) canvas')", LONG, "the image")
        self.at("images", 5)
        truth = self.truth()
        points = truth[os.path.basename(self.state("landmarks annotate")["state"]["path"])]
        for n, (x, y) in enumerate(points[:7]):
            self.click_image(x, y)
            self.at("points", n + 1)
        # One click is undone and redone.
        self.page.click("button", "Undo")
        self.at("points", 6)
        self.page.click("button", "Redo")
        self.at("points", 7)
        # The last point by keys only: the cross is moved to it, and Enter clicks.
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

        # Killing the program loses nothing: the journal has every click.
        self.page.click("button", "Mirrored points")
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
            self.page.click("button", "Confirm and continue")
            self.until("the next image", lambda: (lambda now: now["image"] != state["image"] or now["done"] != state["done"])(
                self.state("landmarks annotate")["state"]))
        self.at("done", 5)
        self.path("annotate-images")
        self.page.click("button", "Save and end")
        self.page.wait_text("Saved as")
        self.path("annotate-saved")

        self.page.click("link", "Train with it")
        self.page.wait("document.querySelector('main[data-page=train][data-ready=yes]')")
        self.page.click("button", "Train")
        self.page.click("button", "Evaluate this model", timeout=LONG)
        self.page.find("button", "Evaluate")
        self.page.fill("textbox", "Eyes", "0 3")
        self.page.choose("Compare", "no")
        self.page.click("button", "Evaluate")
        self.page.wait_text("Worst cases first", LONG)
        self.page.wait("document.querySelectorAll('.found').length >= 8", 60, "points on the worst image")
        self.assertIn("Mean error", self.page.text("main"))
        self.path("train-worst")

    def drag_points(self, truth):
        """Wrong proposals are dragged to the right places, by their positions if the session reports them."""
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

    @long
    def test_train_and_compare(self):
        self.go("/train")
        self.page.choose("Model", "3")  # the appearance model: seconds
        self.page.click("button", "Try with synthetic data")
        self.page.wait("[...document.querySelectorAll('main select')].some((one) => one.value.endsWith('heads/set.json'))",
                       LONG, "drawn heads")
        self.page.fill("spinbutton", "Hold out", "3")
        self.page.click("button", "Train")
        self.page.wait_text("aam train, ", LONG)  # until then the page shows an earlier training, with its own "Evaluate this model"
        self.page.click("button", "Evaluate this model", timeout=LONG)
        self.page.fill("spinbutton", "Held out", "3")
        self.page.click("button", "Evaluate")
        self.page.wait_text("Worst cases first", LONG)
        self.assertEqual(
            self.page.evaluate("[...document.querySelectorAll('main table')[0].tHead.rows[0].cells].map((one) => one.innerText)"),
            ["Figure", "Your model", "Shipped model", "Better"])
        self.path("train-compare")

        # From now on the new model replaces the installed one.
        self.page.wait_text("Of ")
        self.page.click("button", "Install")
        self.page.click("button", "Install it")
        self.page.wait_text("Installed as aam68")
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
        # A file that is not such a model is refused and does not change the installed model.
        reference = [one for one in self.server.call("/api/jobs")[1]["jobs"] if one["verb"] == "pose synth"][0]["id"]
        answer = self.server.call("/api/run", {"verb": "models install", "inputs": [f"job:{reference}/heads/set.json"]})[1]
        self.assertEqual(answer["exit"], 5, answer)
        self.assertEqual(self.server.call("/api/run", {"verb": "models install", "inputs": ["/etc/passwd"]})[0], 400)
        self.assertEqual(self.server.call("/api/run", {"verb": "models install", "inputs": ["model:head"], "flags": {"--own-dir": "/tmp"}})[0], 400)

        self.go("/system")
        self.page.click("tab", "Models")
        self.page.wait_text("your own")
        self.path("system-own-model")
        self.page.click("button", "Restore the shipped model aam68")
        self.page.click("button", "Remove my model")
        self.page.wait("!document.querySelector('main').innerText.includes('your own')", 60, "the shipped model again")
        self.assertFalse(os.path.exists(own))
        events = [one["event"] for one in self.server.call("/api/audit")[1]["lines"]]
        self.assertIn("model install", events)
        self.assertIn("model remove", events)

    def test_calibrate_print_show_save(self):
        self.go("/calibrate")
        self.page.click("button", "Create the sheet")
        self.page.wait_text("Download board.pdf")
        status, sheet = self.server.call(f"/api/jobs/{self.job_of('ar marker-sheet')['id']}/files/board.pdf")
        self.assertEqual(status, 200)
        self.assertTrue(sheet.startswith(b"%PDF"))
        self.path("calibrate-print")

        self.page.click("button", "I have a board: continue")
        self.page.click("button", "Try with synthetic data")
        self.until("the camera is calibrated", lambda: self.values("calibrate").get("calibrated"))
        self.path("calibrate-live")
        self.page.click("button", "Finish and save the camera")
        self.page.wait_text("The camera is saved as")
        self.page.wait_text("distortion:")
        status, camera = self.server.call("/api/state/camera.yaml")
        self.assertEqual(status, 200)
        self.assertIn(b"fx:", camera)
        self.path("calibrate-kept")

        # A camera that cannot be written is not said to be saved, and the session stays with its error.
        os.mkdir(os.path.join(self.server.workspace, "taken.yaml"))
        self.page.fill("textbox", "Name of the camera file", "taken")
        self.page.click("button", "Try with synthetic data")
        self.until("a second camera is calibrated", lambda: self.values("calibrate").get("calibrated"))
        self.page.click("button", "Finish and save the camera")
        self.page.wait_text("Ended:")
        self.page.wait_text("Not saved:")
        self.assertNotIn("is saved as", self.page.text("main"))
        self.page.click("button", "Close")
        self.page.find("button", "Try with synthetic data")
        self.assertNotIn("is saved as", self.page.text("main"))

    @long
    def test_calibrate_from_images(self):
        self.go("/calibrate")
        self.page.click("tab", "Or use images")
        self.page.click("button", "Try with synthetic data")
        self.page.wait_text("Camera parameters", LONG)
        self.assertRegex(self.page.text("main"), r"Reprojection error 0\.\d+ px, \d+ of \d+ images used")
        self.page.wait_text("Views, largest error first")
        self.path("calibrate-photos")


if __name__ == "__main__":
    pages.main()
