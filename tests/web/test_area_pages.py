#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The pages of the areas, empty, and complete workflows through those of people, plates and exploring, as a user does them.
On the real server, with synthetic people and streets."""

import json
import os
import re
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import pages  # noqa: E402
from area_page import AreaPageTest, LONG, WIDTHS  # noqa: E402

AREAS = ["plates", "people", "reconstruct", "annotate", "calibrate", "train", "explore"]


class AreaPages(AreaPageTest):
    def test_0_each_page(self):
        for name in AREAS:
            with self.subTest(page=name):
                self.go(f"/{name}")
                self.page.find("heading", contains={"train": "Train and evaluate"}.get(name, name))
                self.check_page(f"empty-{name}", widths=(*WIDTHS, 1440))

    def test_0_each_tab(self):
        for name, tabs in {
            "people": ["Enrol a person", "Identify", "Live"],
            "calibrate": ["2. Show it to the camera", "Or use images"],
            "train": ["Evaluate"],
        }.items():
            self.go(f"/{name}")
            for tab in tabs:
                with self.subTest(page=name, tab=tab):
                    self.page.click("tab", tab)
                    self.check_page(f"empty-{name}-{re.sub('[^a-z]+', '-', tab.lower()).strip('-')}", widths=WIDTHS)

    def enrol(self, name):
        self.page.click("tab", "Enrol a person")
        self.page.click("button", contains=name, timeout=LONG)
        self.page.click("button", "Enrol", timeout=LONG)
        self.page.wait_text("images were accepted", LONG)
        taken, shots = map(int, re.search(r"(\d+) of (\d+) images were accepted", self.page.text("main")).groups())
        self.assertEqual(shots, 10)
        self.assertGreaterEqual(taken, 3)

    def test_people_enrol_recognise_forget(self):
        self.go("/people")
        self.enrol("Ann (synthetic)")
        self.path("people-enrolled")
        self.page.click("button", "Enrol another person")
        self.enrol("Ben (synthetic)")
        self.page.click("button", "Identify a face")
        seen = set()
        for _ in range(6):
            before = self.page.text(".boxed + *, section[aria-label='Result']")
            self.page.click("button", "Try with synthetic data")
            self.page.wait(
                "document.querySelector('section[aria-label=\"Result\"]')?.innerText && "
                f"document.querySelector('section[aria-label=\"Result\"]').innerText !== {json.dumps(before)} && "
                "!document.querySelector('.is-busy')", what="an answer")
            seen.update(re.findall(r"Ann \(synthetic\)|Ben \(synthetic\)", self.page.text("section[aria-label='Result'] h2")))
        self.assertEqual(seen, {"Ann (synthetic)", "Ben (synthetic)"})
        self.path("people-recognised")

        self.page.click("tab", "Gallery")
        self.page.find("button", "Forget Ann (synthetic)")
        self.path("people-gallery")
        self.correct_named("Ann (synthetic)", "Ben (synthetic)")
        self.page.click("button", "Forget Ann (synthetic)")
        self.page.click("button", "Forget")
        self.page.wait_text("Data items searched for")
        self.assertIn("None of them remains", self.page.text("dialog[open]"))
        pages.shot(self.page, "path-people-forgotten")
        self.page.click("button", "Close")
        self.page.wait("!document.body.innerText.includes('Forget Ann')")

    def people(self):
        """The number of faces of each person, as the program reports it."""
        lines = self.server.call("/api/run", {"verb": "people list", "inputs": [], "flags": {}})[1]["lines"]
        return {one["name"]: one["faces"] for one in lines}

    def faces_of(self, name):
        """Opens the dialog of a person's faces. Returns the names of the check boxes."""
        self.page.click("button", f"Faces of {name}")
        self.page.find("checkbox", contains="Face ")
        return [one for _, one, _ in self.page.find_all("checkbox") if one.startswith("Face ")]

    def first_button(self, beginning):
        """The whole name of the first button whose name begins with this text; waits for it."""
        self.page.find("button", contains=beginning)
        return next(name for _, name, _ in self.page.find_all("button") if name.startswith(beginning))

    def undo_last(self):
        """Undoes the newest active correction."""
        undo = self.first_button("Undo correction")
        self.page.click("button", undo)
        self.page.wait(f"!document.querySelector('[aria-label={json.dumps(undo)}]')", 30, "the correction is undone")

    def correct_named(self, one, other):
        """Faces of named people: split off, moved, ruled out, two names merged. Each correction is undone."""
        before = self.people()
        boxes = self.faces_of(one)
        self.assertEqual(len(boxes), before[one])
        self.page.wait("document.querySelector('.face-choice image').getBoundingClientRect().width > 100", 30, "faces")
        for box in boxes[:2]:
            self.page.click("checkbox", box)
        self.page.wait_text(f"2 of {before[one]} faces are selected")
        self.page.fill("textbox", "Name", other)
        self.page.wait_text("This name is already enrolled")
        name = "Zoe <b>"
        self.page.fill("textbox", "Name", name)
        self.path("people-faces")
        self.page.click("button", "Move")
        self.page.wait_text(f"0 of {before[one] - 2} faces are selected")
        self.assertEqual(self.people(), {**before, one: before[one] - 2, name: 2})

        moved = next(one for _, one, _ in self.page.find_all("checkbox") if one.startswith("Face "))
        self.page.click("checkbox", moved)
        self.page.choose("Move them to", other)
        self.page.click("button", "Move")
        self.page.wait_text(f"0 of {before[one] - 3} faces are selected")
        self.assertEqual(self.people(), {one: before[one] - 3, other: before[other] + 1, name: 2})
        against = next(one for _, one, _ in self.page.find_all("checkbox") if one.startswith("Face "))
        self.page.click("checkbox", against)
        self.page.click("button", contains=f"Not {one}")
        self.page.wait_text(f"0 of {before[one] - 4} faces are selected")
        self.page.click("button", "Close")

        self.faces_of(name)
        self.page.choose(f"{name} is the same person as", one)
        self.page.click("button", "Merge")
        self.page.wait("!document.querySelector('dialog[open]')")
        self.assertEqual(self.people(), {one: before[one] - 2, other: before[other] + 1})
        self.page.wait_text(f"{name} merged into {one}")
        self.path("people-named-corrected")
        for _ in range(4):
            self.undo_last()
        self.assertEqual(self.people(), before)

    def groups_there(self, count):
        """Waits for this number of groups, and for all other lists of the page: a new row above would move the next click's
        target."""
        self.page.wait("[...document.querySelectorAll('button')].filter((one) => "
                       f"one.getAttribute('aria-label')?.startsWith('Name group')).length === {count}", what=f"{count} groups")
        self.page.wait_posts()

    def test_people_groups_named_merged_corrected(self):
        """Unknown faces: grouped, named, merged, "not this person". Each is undone."""
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
        self.page.find("button", contains="Name group")
        self.page.click("button", "Show faces")
        self.page.wait("document.querySelector('img.sheet')?.naturalWidth > 100", 60, "the sheet")
        self.assertEqual([one for one in self.server.call("/api/jobs")[1]["jobs"] if one["verb"] == "people groups"], [])
        self.path("people-groups")
        buttons = [name for _, name, _ in self.page.find_all("button") if name.startswith("Name group")]
        self.assertEqual(len(buttons), 3)

        # A face in a group that belongs to another person.
        boxes = self.faces_of("group " + buttons[0].split()[-1])
        self.assertEqual(len(boxes), 2)
        self.page.click("checkbox", boxes[0])
        self.page.click("button", "Make a new group of them")
        self.page.wait_text("0 of 1 faces are selected")
        self.path("people-group-faces")
        self.page.click("button", "Close")
        self.groups_there(4)
        self.undo_last()
        self.groups_there(3)

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
        self.page.wait_text("was merged into group")
        self.groups_there(1)
        wrong = self.first_button("Not this person")
        self.page.click("button", wrong)
        self.page.wait_text(f"not {name}")
        self.path("people-corrected")
        for _ in range(3):
            self.undo_last()
        self.groups_there(3)

    def test_people_name_with_markup_stays_text(self):
        self.go("/people")
        self.page.click("tab", "Enrol a person")
        name = "<img src=x onerror=alert(1)>"
        self.page.fill("textbox", "Name", name)
        self.page.fill("textbox", "Consent", "<b>yes</b>")
        self.page.click("checkbox", "This person has given consent")
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
        self.until("the events of the day", lambda: self.count() >= 10 and self.count() == self.stored())
        every = self.count()
        self.page.wait("document.querySelectorAll('.plate img').length > 3", 60, "images of plates")
        self.path("plates-day")

        text = self.page.text(".plate-text")
        self.assertRegex(text, r"^[A-Z0-9]{4,}$")
        self.page.fill("searchbox", "Plate text", text[1:4])
        self.page.click("button", "Search")
        self.page.wait("document.querySelector('main p[role=status]').innerText.endsWith('found')", 30, "what was found")
        self.assertLess(self.count(), every)
        self.assertIn(text, self.texts())
        wrong = ("X" if text[0] != "X" else "Y") + text[1:]
        self.page.fill("searchbox", "Plate text", wrong)
        self.page.click("checkbox", "Similar texts")
        self.page.click("button", "Search")
        self.until("the near text", lambda: text in self.texts())
        self.page.click("button", "Show all")
        self.page.choose("When", "12h")
        self.page.click("button", "Search")
        self.until("fewer in the last 12 hours", lambda: 0 < self.count() < every)
        self.path("plates-search")

        self.page.click("button", f"More about {text}")
        self.page.wait_text("Confidence of each character")
        pages.shot(self.page, "path-plates-detail")
        self.page.fill("textbox", "Correct text", "ABC 123")
        self.page.click("button", "Correct")
        self.page.wait_text("read as")
        lines = self.server.call("/api/run", {"verb": "plate log", "inputs": ["ws:plates.db"], "flags": {"--text": "ABC123"}})[1]["lines"]
        self.assertEqual([(one["text"], one["correction"]["text"]) for one in lines], [(text, "ABC123")])
        self.path("plates-corrected")
        self.page.click("button", "Save as training data")
        self.page.wait_text("has 1 corrected plates")
        self.page.click("button", "More about ABC123")
        self.page.click("button", self.undo_button())
        self.until("the text as it was read", lambda: "ABC123" not in self.texts())

    def undo_button(self):
        self.page.wait_text("Undo the correction of")
        return next(one[1] for one in self.page.find_all("button") if one[1].startswith("Undo the correction of"))

    def test_plates_watch_list(self):
        self.go("/plates")
        self.page.fill("textbox", "Plate", "b-12?4*")
        self.page.fill("textbox", "Label", "Ann")
        self.page.fill("textbox", "Hours", "06:00-22:00")
        self.page.click("button", "Add to the watch list")
        self.page.wait_text("06:00-22:00")
        with open(os.path.join(self.server.workspace, "watch.csv")) as file:
            self.assertIn("B12?4*,Ann,0.25,,06:00-22:00,", file.read())
        self.path("plates-watch")
        self.page.fill("textbox", "Plate", "2863SDN")
        self.page.fill("textbox", "Hours", "8-9")
        self.page.wait_text("Enter a time range, such as 08:00-18:00")
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
        # All modes have a slider; further sliders appear on request.
        every = len(self.server.call(f"/api/sessions/{self.state('aam explore')['id']}")[1]["sliders"])
        self.assertGreater(every, 8)
        self.assertEqual(len(self.page.find_all("slider")), 8)
        for kind in ("shape", "look"):
            self.page.click("button", contains=f"modes of {kind}")
        self.until("a slider for each mode", lambda: len(self.page.find_all("slider")) == every)
        self.page.slide("Look 7", -2)
        self.until("the look has changed", lambda: self.values("aam explore").get("look", [0] * 7)[6] < -1.5)
        self.path("explore-all")
        self.page.click("button", "Reset look")
        self.until("the look is the mean", lambda: not any(self.values("aam explore").get("look", [1])))
        self.page.click("button", contains="random")
        self.path("explore")
        self.page.click("button", "End")
        self.page.choose("Kind", "points")
        self.page.click("button", "Explore")
        self.page.wait("document.querySelector('.live-view:not(.is-waiting) canvas')", 60, "a patch")
        self.path("explore-points")
        self.page.click("button", "End")


if __name__ == "__main__":
    pages.main()
