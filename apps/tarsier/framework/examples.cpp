// SPDX-License-Identifier: MIT
#include "framework/cli.h"
#include "framework/command_tree.h"
#include <map>

namespace tarsier::cli {
namespace {

// The examples of all verbs in one place, so that they stay consistent. The test cli_verbs checks
// that every verb has one and that its flags exist.
std::string example_of(const std::string& verb) {
  static const std::map<std::string, std::string> table = {
      {"cartoon run", "photo.jpg -o drawn.png --mode sketch"},
      {"landmarks annotate", "video.mp4 -o set.yaml"},
      {"landmarks import", "helen/ -o set.json"},
      {"landmarks show", "set.yaml -o sheet.png --numbers"},
      {"landmarks train shape", "set.yaml -o shape.json"},
      {"landmarks train patches", "set.yaml -o patches.json --patch 15"},
      {"landmarks train detector", "set.yaml -o detector.json"},
      {"landmarks train trees", "set.yaml -o trees.json --mirror"},
      {"landmarks train tracker", "set.yaml -o mine.json --mirror --hold-out 5"},
      {"landmarks train network", "set.yaml --model mine.json -o mine2.json --mirror"},
      {"landmarks train visibility", "set.yaml --model mine.json -o mine2.json --mirror"},
      {"landmarks train face-detector", "boxes.xml -o finder.json"},
      {"landmarks train face-networks", "boxes.xml --without streets -o finder.json"},
      {"landmarks fit", "group.jpg -o points.png"},
      {"landmarks track", "video.mp4 --csv points.csv"},
      {"landmarks adapt", "me.yaml -o me.json"},
      {"landmarks eval", "set.yaml --model mine.json --held-out 5"},
      {"aam train", "set.yaml -o mine.json"},
      {"aam explore", "--grid modes.png"},
      {"aam fit", "photo.jpg -o fitted.png --draw face"},
      {"aam eval", "set.yaml --model mine.json"},
      {"pose solve", "--object cube.txt --points seen.txt --focal 760"},
      {"pose train-head", "set.yaml -o head.json"},
      {"pose train-view", "--truth head/truth.jsonl -o view.json"},
      {"pose track", "photo.jpg -o posed.png --draw glasses"},
      {"pose eval", "--truth head/truth.jsonl"},
      {"pose synth", "--video --count 100 -o head"},
      {"people enroll", "Ann ann/ --note \"agreed on 1 May\""},
      {"people list", "--gallery people.db"},
      {"people forget", "Ann"},
      {"people export", "-o mine"},
      {"people group", "--false-merges 0.001"},
      {"people groups", "--draw groups.png"},
      {"people name", "3 Ann --note \"agreed on 1 May\""},
      {"people correct not", "--sighting 12"},
      {"people correct move", "Ben --face 7"},
      {"people correct merge", "\"Person 2\" Ann"},
      {"people correct split", "Ann Zoe --face 7"},
      {"people correct undo", ""},
      {"people log", "--limit 20"},
      {"people train", "--algorithm lbph"},
      {"people index", "people.db --check"},
      {"people identify", "party.jpg -o named.png"},
      {"people verify", "Ann door.jpg"},
      {"people show", "-o inside.png"},
      {"people eval", "faces.lst --csv rates.csv"},
      {"people live", "0 --window"},
      {"people liveness", "0 --window"},
      {"plate read", "car.jpg --json"},
      {"plate segment", "photos/ -o cut"},
      {"plate train-detector", "photos/ -o detector.json"},
      {"plate train-reader", "plates/ --scenes photos/ -o reader.json"},
      {"plate eval", "photos/ --truth photos/truth.csv"},
      {"plate sweep", "plates/ -o sweep.png"},
      {"plate synth", "-o cars --count 20 --kind europe"},
      {"plate log", "plates.db --text '24*K?D' --since 12h"},
      {"plate watch add", "visitors.csv 2471KFD --label Ann --hours 06:00-22:00"},
      {"plate watch remove", "gate.csv 2471KFD"},
      {"plate watch list", "gate.csv"},
      {"plate watch test", "gate.csv 2471KFO --at 2026-05-01T12:30"},
      {"sfm reconstruct", "photos/ -o model"},
      {"sfm plan", "photos/ -o work --shards 8 --slurm"},
      {"sfm features", "work --shard 3/8"},
      {"sfm match", "work --shard 3/8"},
      {"sfm map", "work -o model"},
      {"sfm merge", "work -o model"},
      {"sfm dense", "model -o dense"},
      {"sfm mesh", "dense -o mesh.glb"},
      {"sfm synth", "-o scene --images 12"},
      {"sfm eval", "model --truth scene/truth.jsonl"},
      {"calibrate", "photos/ --board chess:9x6 --square 25mm -o camera.yaml"},
      {"ar marker-sheet", "--board chess:9x6 --square 25mm -o board.pdf"},
      {"ar markers", "video.mp4 --size 50mm --camera camera.yaml -o drawn.mp4 --draw cube"},
      {"ar eval", "scenes/truth.jsonl"},
      {"ar synth", "markers -o scenes --count 10 --family 36h11"},
      {"ar target-train", "poster.jpg -o poster.target.json --width 42cm"},
      {"ar target-track",
       "video.mp4 --target poster.target.json --camera camera.yaml -o drawn.mp4"},
      {"models list", ""},
      {"models info", "landmarks68"},
      {"models verify", ""},
      {"models import", "face_recognition_model-weights_manifest.json"},
      {"models install", "head.json --own-dir models"},
      {"models remove", "head --own-dir models"},
      {"doctor", ""},
      {"hub", "mqtt://127.0.0.1/tarsier --log events.db"},
      {"merge", "part-1.jsonl part-2.jsonl -o all.jsonl"},
      {"demo", "-o page --only cartoon,plate"},
      {"serve", "--workspace studio --allow-source door=rtsp://192.168.1.20/stream"},
      {"bench aam", "--json"},
      {"bench cartoon", "--size 640x480 --only sketch,paint"},
      {"bench eyes", "--json"},
      {"bench landmarks", "--json"},
      {"bench people", "--json"},
      {"bench plate", "--json"},
      {"bench calibrate", "--json"},
      {"bench markers", "--json"},
      {"bench posit", "--json"},
      {"bench render", "--json"},
      {"bench sfm", "--only ring12"},
      {"bench steady", "--json"},
      {"bench targets", "--json"},
  };
  const auto at = table.find(verb);
  if (at == table.end()) return {};
  return "tarsier " + verb + (at->second.empty() ? "" : ' ' + at->second);
}

}  // namespace

void add_examples(Command& app) {
  for (const Command* part : app.subcommands()) {
    Command& command = *app.find(part->name());
    command.example(example_of(verb_of(command)));
    add_examples(command);
  }
}

}  // namespace tarsier::cli
