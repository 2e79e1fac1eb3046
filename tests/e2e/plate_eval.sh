#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# plate eval: the figures of results against a ground truth, compared with a second scorer if there is one.
. "$(dirname "$0")/lib.sh"

cat >truth.csv <<'CSV'
image,x,y,w,h,text
a.jpg,0,0,100,20,1234BCD
a.jpg,200,0,100,20,5678FGH
b.jpg,0,0,100,20,M0123AB
c.jpg,0,0,100,20,9999ZZZ
CSV
cat >results.jsonl <<'JSON'
{"image":"set/a.jpg","plates":[{"text":"1234BCD","confidence":0.9,"box":[0,0,100,20]},{"text":"5678FGN","confidence":0.8,"box":[200,0,100,20],"candidates":["5678FGN","5678FGH"]}],"ms":10}
{"image":"set/b.jpg","plates":[{"text":"MO123AB","confidence":0.5,"box":[0,0,100,20]}],"ms":20}
{"image":"set/c.jpg","plates":[],"ms":30}
JSON
run plate eval results.jsonl --truth truth.csv --json
expect_status 0
expect_out '"recall":0.75,' '"exact":0.25,' '"top10":0.5,' '"conf_auc":1.0,' '"median_ms":20.0,' 'found 3/4 exact 1/4' \
  '"exact_interval":\[0.0456,0.6994\]' '"calibration_error":0.' '"sure":0'
run plate eval results.jsonl --truth truth.csv --fold --errors
expect_status 0
expect_out '^exact .*50.0 %' '^read +a.jpg +5678FGH +5678FGN' '^missed +c.jpg +9999ZZZ'
if grep -q 'b.jpg' stdout.txt; then fail 'an exact plate among the errors'; fi
run plate eval results.jsonl --truth truth.csv --csv outcomes.csv --quiet
expect_status 0
[ "$(wc -l <outcomes.csv)" -eq 5 ] || fail "outcomes.csv: $(cat outcomes.csv)"
grep -q '^a.jpg,5678FGH,1,5678FGN,0.8000,1,0$' outcomes.csv || fail "outcomes.csv: $(cat outcomes.csv)"
status=0
"$TARSIER" plate eval - --truth truth.csv --json <results.jsonl >stdout.txt 2>stderr.txt || status=$?
[ "$status" -eq 0 ] && grep -q 'exact 1/4' stdout.txt || fail "plate eval - : $(cat stdout.txt stderr.txt)"

# What is broken is named with its line.
run plate eval missing.jsonl --truth truth.csv
expect_status 3
expect_error 'missing.jsonl'
run plate eval results.jsonl --truth missing.csv
expect_status 3
expect_error 'missing.csv'
{ cat results.jsonl; echo '{"image": "d.jpg", "plates": [{"confidence": 1}]}'; } >broken.jsonl
run plate eval broken.jsonl --truth truth.csv
expect_status 3
expect_error 'broken.jsonl: line 4: no text "text"'
noise 3000 >noise.jsonl
run plate eval noise.jsonl --truth truth.csv
expect_status 3
expect_error 'noise.jsonl: line 1'
head -c 100000 /dev/zero | tr '\0' '[' >nested.jsonl
run plate eval nested.jsonl --truth truth.csv
expect_status 3
expect_error 'nested.jsonl: line 1'
{ cat truth.csv; echo 'd.jpg,1,2,wide,4,X'; } >broken.csv
run plate eval results.jsonl --truth broken.csv
expect_status 3
expect_error 'broken.csv: line 6: .wide. is not a valid w'
run plate eval results.jsonl --truth truth.csv --truth truth.csv
expect_status 3
expect_error "a.jpg' is in two ground-truth files"
run plate eval results.jsonl
expect_status 2
run plate eval results.jsonl --truth truth.csv --csv missing/outcomes.csv
expect_status 6
expect_error 'missing'

# The same figures as the other scorer, on random readings of random plates.
scorer=$TARSIER_DATA/../eval/eval_anpr.py
if [ -f "$scorer" ] && command -v python3 >/dev/null; then
  for seed in 1 2 3; do
    python3 - "$seed" <<'PY'
import json, random, sys
r = random.Random(int(sys.argv[1]))
letters = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ"
truth, results = open("random.csv", "w"), open("random.jsonl", "w")
truth.write("image,x,y,w,h,text\n")
for i in range(60):
    plates = []
    for k in range(r.randint(0, 3)):
        text = "".join(r.choice(letters) for _ in range(r.randint(4, 8)))
        box = [r.randint(0, 500), r.randint(0, 300), r.randint(40, 200), r.randint(10, 50)]
        hidden = "".join(c if r.random() > 0.05 else "-" for c in text)
        kind = r.random()
        truth.write("i%d.jpg,%s,%s\n" % (i, ",,," if kind < 0.1 else ",".join(map(str, box)), "" if 0.1 < kind < 0.2 else hidden))
        def misread():
            return "".join(c if r.random() > 0.04 else r.choice(letters + "OQDI01") for c in text if r.random() > 0.02)
        if r.random() < 0.85:
            read = misread()
            plate = {"text": read, "confidence": round(r.random(), 2), "box": [v + r.uniform(-9, 9) for v in box]}
            if r.random() < 0.7: plate["candidates"] = [read] + [{"text": misread()} for _ in range(r.randint(0, 14))]
            if r.random() < 0.03: del plate["box"]
            plates.append(plate)
    if r.random() < 0.1: plates.append({"text": "XX", "box": [1, 1, 9, 9]})
    if r.random() < 0.95:
        line = {"image": "set/i%d.jpg" % i, "plates": plates}
        if r.random() < 0.9: line["ms"] = r.uniform(1, 50)
        results.write(json.dumps(line) + "\n")
PY
    for flags in "" --fold "--iou 0.7"; do
      # shellcheck disable=SC2086
      python3 "$scorer" random.jsonl random.csv --json $flags >expected.json
      # shellcheck disable=SC2086
      run plate eval random.jsonl --truth random.csv --json $flags
      expect_status 0
      python3 - <<'PY' || fail "seed $seed $flags: other figures than $scorer"
import json
expected, got = json.load(open("expected.json")), json.load(open("stdout.txt"))
common = {key: got.get(key) for key in expected}  # the program prints more than the scorer
assert expected == common, "\n%s\n%s" % (expected, got)
PY
    done
  done
fi
finish
