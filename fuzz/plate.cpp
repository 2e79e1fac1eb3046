// SPDX-License-Identifier: MIT
// Countries, truth, results and models of number plates.
#include "tarsier/core/errors.h"
#include "tarsier/plate/classic/character_reader.h"
#include "tarsier/plate/classic/plate_svm.h"
#include "tarsier/plate/classic/xml_matrix.h"
#include "tarsier/plate/networks/recognizer.h"
#include "tarsier/plate/text/country.h"
#include "tarsier/plate/text/evaluation.h"
#include "tarsier/plate/text/symbol_labels.h"
#include "tarsier/plate/tracking/log.h"
#include "tarsier/plate/tracking/watch.h"

#include <opencv2/core.hpp>

#include "fuzz.h"
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

namespace tarsier::fuzz {

using namespace tarsier::plate;

TARSIER_FUZZ_TARGET(plate_country, kBytes) {
  const Country country = parse_country(text_of(input), "xx.txt");
  for (const Layout& layout : country.layouts) {
    expect(layout.positions.size() >= 2 && layout.positions.size() <= 12,
           "a layout of another length");
    expect(std::isfinite(layout.weight) && layout.weight > 0, "a weight that is none");
    expect(std::isfinite(layout.prior) && layout.prior > 0, "a prior that is none");
    expect(
        layout.group_break >= 0 && layout.group_break < static_cast<int>(layout.positions.size()),
        "a break beside the text");
    for (const SymbolSet position : layout.positions) expect(position != 0, "a place for nothing");
  }
  const CountryChoice choice = choose_countries({country}, {"any"});
  (void)weighted_by_aspect(choice, AspectRange::kShort);
}

TARSIER_FUZZ_TARGET(symbol_labels, kBytes) {
  for (const SymbolLabel& label : parse_symbol_labels(text_of(input), "plate.txt")) {
    expect(label.class_id >= 0 && label.class_id < kBlank, "a class out of range");
    expect(std::abs(label.x) < 2 && std::abs(label.y) < 2, "a box far away");
    expect(label.w > 0 && label.w < 2 && label.h > 0 && label.h < 2, "a box of no size");
  }
}

TARSIER_FUZZ_TARGET(plate_truth, kBytes) {
  const PlateTruth truth = read_plate_truth(file_of(input, "truth.csv"));
  (void)evaluate_plates({}, truth, {});
}

TARSIER_FUZZ_TARGET(plate_readings, kJson) {
  std::istringstream lines{std::string(text_of(input))};
  const std::vector<ImageReadings> readings = parse_readings(lines, "lines");
  PlateTruth truth;
  for (const ImageReadings& image : readings)
    truth[image.image] = {{cv::Rect2d(10, 20, 100, 20), "1234BCD"}, {std::nullopt, "AB-12"}};
  (void)scores_json(evaluate_plates(readings, truth, {.iou = 0.5, .fold = true}));
}

TARSIER_FUZZ_TARGET(plate_detector, kJson) {
  const DetectorModel model = read_detector_model(file_of(input, "model.json"));
  const cv::Mat gray(64, 96, CV_8UC1, cv::Scalar(90));
  linalg::Workspace workspace;
  (void)detect(gray, model.detector, {}, workspace);
}

TARSIER_FUZZ_TARGET(plate_reader, kJson) {
  const ReaderModel model = read_reader_model(file_of(input, "model.json"));
  const std::vector<float> line(static_cast<std::size_t>(kLineHeight * kLineWidth), 0.25F);
  linalg::Workspace workspace;
  (void)linalg::run(model.line, line.data(), {1, kLineHeight, kLineWidth}, workspace);
}

TARSIER_FUZZ_TARGET(plate_svm, kJson) {
  const PlateSvm svm = read_plate_svm(file_of(input, "model.json"));
  (void)svm.platt.probability(svm.margin(cv::Mat(33, 144, CV_8UC1, cv::Scalar(7))));
}

TARSIER_FUZZ_TARGET(character_reader, kJson) {
  const CharacterReader reader = read_character_reader(file_of(input, "model.json"));
  const auto probabilities = reader.probabilities(cv::Mat(20, 20, CV_8UC1, cv::Scalar(7)));
  expect(probabilities.size() == reader.symbols.size(), "chances of other symbols");
}

TARSIER_FUZZ_TARGET(xml_matrices, kBytes) {
  const XmlLimits limits{1'000'000, 2000, 10'000, 100'000, 8};
  (void)parse_xml_matrices(text_of(input), "sets.xml", limits);
  const std::string path = file_of(input, "sets.xml");
  try {
    (void)read_plate_set(path);
  } catch (const Error&) {
  }
  (void)read_character_set(path);
}

TARSIER_FUZZ_TARGET(plate_watch, kBytes) {
  const WatchList list = WatchList::parse(text_of(input), "watch.csv");
  for (const WatchEntry& entry : list.entries()) {
    entry.check();
    (void)watch_entry_json(entry);
  }
  for (const char* text : {"1234BCD", "2471KFD", ""}) {
    for (const WatchMatch& match : list.matches(text, {4, 1439}, nullptr))
      expect(match.distance <= match.entry->errors, "a match that is too far away");
  }
  // The written list has the same content, whatever the layout of the file.
  const std::string written = list.text();
  const WatchList again = WatchList::parse(written, "again.csv");
  expect(again.entries().size() == list.entries().size(), "another number of entries");
  expect(again.text() == written, "another list when it is written again");
}

TARSIER_FUZZ_TARGET(plate_log, kBytes) {
  PlateLog log(file_of(input, "log.db"), DatabaseAccess::kRead, 0);
  std::int64_t last = 0;
  log.query({}, [&](const LoggedPlate& entry) {
    last = entry.id;
    return true;
  });
  (void)log.crop(last);
  for (const char* pattern : {"1234BCD", "12*", "*34B*", "?2*", "*"}) {
    LogFilter filter;
    filter.text = pattern;
    (void)log.query(filter, [](const LoggedPlate&) { return true; });
    filter.near = true;
    (void)log.query(filter, [](const LoggedPlate&) { return true; });
  }
}

}  // namespace tarsier::fuzz
