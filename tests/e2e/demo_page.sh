#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# demo writes a self-contained page: all files that it refers to are beside it, none on a network.
. "$(dirname "$0")/lib.sh"

# Videos take most of the time: `./test --all` draws those of plates, markers and targets too.
short=(--only "cartoon,landmarks,aam,pose,people,calibrate")
[ -z "${TARSIER_TEST_ALL:-}" ] || short=()
run demo -o out --quiet "${short[@]}"
expect_status 0
expect_no_err
[ -s out/index.html ] || fail "no out/index.html"
expect_out "$PWD/out/index.html"
python3 - <<'PY' || fail "the page"
import html.parser, os, re
class Page(html.parser.HTMLParser):
    VOID = {"meta", "img", "input", "link", "br"}
    def __init__(self):
        super().__init__()
        self.files, self.open, self.ids, self.anchors, self.headings = [], [], set(), [], []
    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        if tag not in self.VOID and tag not in {"path", "circle", "ellipse"}:
            self.open.append(tag)
        for key in ("src", "poster"):
            if key in attributes: self.files.append(attributes[key])
        if attributes.get("href", "").startswith("#"): self.anchors.append(attributes["href"][1:])
        elif "href" in attributes: self.files.append(attributes["href"])
        if "id" in attributes: self.ids.add(attributes["id"])
        if tag == "img": assert attributes.get("width") and attributes.get("height"), attributes
    def handle_endtag(self, tag):
        if tag in self.VOID: return
        assert self.open and self.open[-1] == tag, (tag, self.open[-3:])
        self.open.pop()
text = open("out/index.html", encoding="utf-8").read()
page = Page()
page.feed(re.sub(r"<(path|circle|ellipse)([^>]*)/>", r"<\1\2>", text))
assert not page.open, page.open
assert len(page.files) >= 10, page.files
for name in page.files:
    assert not re.match(r"[a-z]+:|/|\.\.", name), name
    assert os.path.getsize(os.path.join("out", name)) > 100, name
assert set(page.anchors) <= page.ids, (page.anchors, page.ids)
assert not re.search(r"https?://|@import|url\(", text), "the page refers to a network"
assert "tarsier cartoon run" in text
if os.environ.get("TARSIER_TEST_ALL"):
    vehicles = re.findall(r"<tr><td>([0-9]{4}[A-Z]{3})</td>", text)
    assert len(vehicles) == len(set(vehicles)) == 3, vehicles  # one line for each vehicle
PY

run demo -o out --only people --json --quiet
expect_status 0
expect_out '"page":"out/index.html"'

: >file
run demo -o file/out
expect_status 6
expect_error 'file'

# Stopped in the middle: 130, and soon.
"$TARSIER" demo -o stopped >stdout.txt 2>stderr.txt &
pid=$!
for _ in $(seq 3000); do [ -e stopped/img ] && break; sleep 0.1; done
kill -TERM $pid
status=0
wait $pid || status=$?
command_line="tarsier demo, stopped" err=$(cat stderr.txt)
case $status in 0 | 130) ;; *) fail "demo stopped by a signal: exit status $status" ;; esac
[ ! -e stopped/index.html ] || [ "$status" -eq 0 ] || fail "a page was written though the demo was stopped"
finish
