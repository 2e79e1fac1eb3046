// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"

#include "tarsier/core/stop.h"
#include "tarsier/core/words.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/reader/reader.h"
#include "tarsier/plate/text/symbol_labels.h"
#include "tarsier/plate/text/text.h"
#include "tarsier/plate/tracking/log.h"
#include "tarsier/plate/tracking/watch.h"

#include <fmt/format.h>

#include "verbs/plate/plate.h"
#include <fcntl.h>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <pwd.h>
#include <span>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

using plate::LoggedPlate;
using plate::Moment;
using plate::PlateLog;

struct PlateLogFlags {
  std::string path;
  std::string text;
  bool near = false;
  std::string since, until;
  std::string source;
  std::int64_t limit = 0;
  std::string csv;
  std::string crops;
  std::string keep;
  const Flag* keep_flag = nullptr;
  std::vector<std::string> correct;  // id and text
  std::optional<int> undo;
  std::string author;
  std::string corrections;
  plate::ReaderOptions reader;  // of --corrections
};

plate::LogFilter filter_of(const PlateLogFlags& flags) {
  plate::LogFilter filter;
  const Moment now = plate::moment_now();
  if (!flags.text.empty()) filter.text = plate::plate_pattern(flags.text, "--text");
  if (flags.near && flags.text.empty()) throw UsageError("--near needs --text");
  filter.near = flags.near;
  if (!flags.since.empty()) {
    filter.since = plate::parse_moment(flags.since, now, false, "--since");
  }
  if (!flags.until.empty()) filter.until = plate::parse_moment(flags.until, now, true, "--until");
  if (filter.since && filter.until && *filter.since > *filter.until) {
    throw UsageError("--since is later than --until");
  }
  filter.source = flags.source;
  filter.limit = flags.limit;
  return filter;
}

std::string line_of(const LoggedPlate& plate) {
  const auto seconds = std::chrono::round<std::chrono::seconds>(plate.last_time - plate.first_time);
  const std::string corrected =
      plate.correction ? fmt::format("  corrected: {} ({})", printable(plate.correction->text),
                                     printable(plate.correction->author))
                       : std::string();
  return fmt::format("{}  {:<10} {:>4.0f} %  {:>6} s  {:>5} frames  {}{}\n",
                     plate::moment_text(plate.first_time).substr(0, 19), printable(plate.text),
                     100 * plate.confidence, seconds.count(), plate.frames, printable(plate.source),
                     corrected);
}

const std::string& text_of(const LoggedPlate& plate) {
  return plate.correction ? plate.correction->text : plate.text;
}

// "12-1234BCD.jpg": no content of a hostile file can lead out of the folder.
std::string crop_name(const LoggedPlate& plate) {
  return fmt::format("{}-{}.jpg", plate.id, plate::plate_symbols(text_of(plate)).substr(0, 20));
}

// Writes CSV in chunks, either to a file (atomically) or to stdout.
class CsvOutput {
 public:
  explicit CsvOutput(const std::string& path) : path_(path) {
    if (path == "-") return;
    file_.emplace(path);
    descriptor_ = ::open(file_->path().c_str(), O_WRONLY | O_CLOEXEC);
    if (descriptor_ < 0) throw OutputError(path, "cannot be written");
  }
  ~CsvOutput() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  CsvOutput(const CsvOutput&) = delete;
  CsvOutput& operator=(const CsvOutput&) = delete;

  void add(const std::string& line) {
    lines_ += line;
    if (lines_.size() >= kBufferSize) flush();
  }
  void finish() {
    flush();
    if (!file_) return;
    if (::close(std::exchange(descriptor_, -1)) != 0) throw OutputError(path_, "cannot be written");
    file_->commit();
  }

 private:
  static constexpr std::size_t kBufferSize = 1 << 16;  // bytes
  void flush() {
    if (file_) {
      write_all(descriptor_, lines_, path_);
    } else {
      print_text(lines_);
    }
    lines_.clear();
  }
  std::string path_;
  std::optional<AtomicFile> file_;
  int descriptor_ = -1;
  std::string lines_;
};

ExitStatus list_plates(const PlateLogFlags& flags, const Context& context) {
  const plate::LogFilter filter = filter_of(flags);
  PlateLog log(flags.path, DatabaseAccess::kRead);
  if (!flags.crops.empty()) make_folder(flags.crops);
  std::optional<CsvOutput> csv;
  if (!flags.csv.empty()) {
    csv.emplace(flags.csv);
    csv->add(plate::logged_csv_header());
  }
  std::int64_t crops = 0;
  const std::int64_t found = log.query(filter, [&](const LoggedPlate& plate) {
    throw_if_stopped(context.stop);
    if (!flags.crops.empty() && plate.has_crop) {
      const std::vector<std::uint8_t> bytes = log.crop(plate.id);
      write_file_atomically(flags.crops + "/" + crop_name(plate),
                            std::span<const std::uint8_t>(bytes));
      ++crops;
    }
    if (csv) {
      csv->add(plate::logged_csv_line(plate));
    } else if (context.json) {
      print_json(plate::logged_json(plate, flags.path));
    } else if (flags.crops.empty()) {
      print_text(line_of(plate));
    }
    return true;
  });
  if (csv) csv->finish();
  if (!flags.csv.empty() && flags.csv != "-")
    log_info("{} entries written to {}", found, flags.csv);
  if (!flags.crops.empty()) log_info("{} images written to {}", crops, flags.crops);
  return found > 0 ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

ExitStatus forget_plates(const PlateLogFlags& flags, const Context& context) {
  const std::chrono::milliseconds age = plate::parse_duration(flags.keep, "--keep");
  PlateLog log(flags.path, DatabaseAccess::kWrite);
  plate::ForgetOptions options;
  // The pause lets other writers in: they check for the lock every 25 to 100 ms.
  options.after_batch = [&](std::int64_t) {
    throw_if_stopped(context.stop);
    (void)sleep_unless_stopped(std::chrono::milliseconds(50), context.stop);
  };
  const std::int64_t deleted = log.forget(plate::moment_now(), age, options);
  if (context.json) {
    print_json({{"deleted", deleted}});
  } else {
    print_text(fmt::format("{} deleted\n", deleted));
  }
  return ExitStatus::kDone;
}

// The user's name in the system.
std::string user_name() {
  char buffer[1024];
  ::passwd entry{};
  ::passwd* found = nullptr;
  if (::getpwuid_r(::getuid(), &entry, buffer, sizeof buffer, &found) == 0 && found != nullptr)
    return found->pw_name;
  return fmt::format("user {}", ::getuid());
}

// Prints the current entry `id`.
void print_corrected(PlateLog& log, std::int64_t id, const Context& context) {
  const std::optional<LoggedPlate> entry = log.entry(id);
  if (!entry) return;
  if (context.json) {
    print_json(plate::logged_json(*entry, log.path()));
  } else {
    print_text(line_of(*entry));
  }
}

ExitStatus correct_plate(const PlateLogFlags& flags, const Context& context) {
  const auto id = to_integer(flags.correct.at(0), 1, std::numeric_limits<std::int64_t>::max());
  if (!id)
    throw UsageError(fmt::format("--correct '{}': expected the id of an entry and its right text",
                                 printable(flags.correct[0])));
  plate::PlateCorrection correction;
  correction.text = plate::plate_pattern(flags.correct.at(1), "--correct");
  if (correction.text.find_first_of("*?") != std::string::npos)
    throw UsageError(fmt::format("--correct '{}': expected letters and digits alone",
                                 printable(flags.correct[1])));
  correction.author =
      flags.author.empty() ? user_name() : plate::checked_label(flags.author, "--author");
  correction.time = plate::moment_now();
  PlateLog log(flags.path, DatabaseAccess::kWrite);
  log.correct(*id, correction);
  print_corrected(log, *id, context);
  return ExitStatus::kDone;
}

ExitStatus undo_correction(const PlateLogFlags& flags, const Context& context) {
  PlateLog log(flags.path, DatabaseAccess::kWrite);
  const bool is_undone = log.undo_correction(*flags.undo);
  if (!is_undone) log_info("entry {} has no correction", *flags.undo);
  print_corrected(log, *flags.undo, context);
  return is_undone ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

// The plate's corners in a crop of a log: from the recogniser, or from the way crops are cut.
plate::Quad corners_in(const cv::Mat& crop, const plate::Recognizer& recognizer) {
  const cv::Rect2f box(static_cast<float>(crop.cols) / 8, static_cast<float>(crop.rows) / 6,
                       static_cast<float>(crop.cols) * 0.75F, static_cast<float>(crop.rows) / 1.5F);
  const cv::Point2f center(box.x + box.width / 2, box.y + box.height / 2);
  for (const plate::Reading& reading : recognizer.read(crop)) {
    if (reading.box.contains(center) && static_cast<float>(reading.box.width) > box.width / 2)
      return reading.corners;
  }
  return plate::quad_of(box);
}

// Writes training data for train-reader: rectified crops of the corrected plates, with their
// characters.
ExitStatus export_corrections(const PlateLogFlags& flags, const Context& context) {
  const plate::LogFilter filter = filter_of(flags);
  PlateLog log(flags.path, DatabaseAccess::kRead);
  const plate::Recognizer recognizer = plate::load_recognizer(ModelStore::find(), flags.reader);
  make_folder(flags.corrections);
  std::int64_t written = 0;
  std::int64_t left_out = 0;
  log.query(filter, [&](const LoggedPlate& plate) {
    throw_if_stopped(context.stop);
    if (!plate.correction) return true;
    const std::string text = plate::plate_symbols(plate.correction->text).substr(0, 20);
    std::optional<plate::TextCrop> cut;
    if (plate.has_crop && !text.empty()) {
      const cv::Mat crop =
          decode_image(log.crop(plate.id), fmt::format("{}: entry {}", flags.path, plate.id));
      cut = recognizer.crop_text(crop, corners_in(crop, recognizer), text);
    }
    if (!cut) {
      ++left_out;
      return true;
    }
    const std::string name = fmt::format("{:06}_log-{}", plate.id, text);
    const std::string path = flags.corrections + "/" + name;
    write_image(path + ".jpg", cut->image, 95);
    write_file_atomically(path + ".txt",
                          plate::symbol_labels_text(text, cut->boxes, cut->image.size()));
    if (context.json) {
      print_json(
          {{"id", plate.id}, {"image", name + ".jpg"}, {"text", text}, {"read", plate.text}});
    } else {
      print_text(fmt::format("{}.jpg\n", path));
    }
    ++written;
    return true;
  });
  log_info("{} corrected plates written to {}{}", written, flags.corrections,
           left_out == 0 ? ""
                         : fmt::format("; {} have no image, two rows, or a text that does not fit",
                                       left_out));
  return written > 0 ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

ExitStatus run_log(const PlateLogFlags& flags, const Context& context) {
  if (!flags.correct.empty()) return correct_plate(flags, context);
  if (flags.undo) return undo_correction(flags, context);
  if (!flags.corrections.empty()) return export_corrections(flags, context);
  return flags.keep_flag->count() > 0 ? forget_plates(flags, context) : list_plates(flags, context);
}

void add_flags(Command& verb, PlateLogFlags& flags) {
  verb.add_option("LOG", flags.path, "log file of `plate read --log`").required();
  std::vector<Flag*> listing;
  listing.push_back(&verb.add_option(
      "--text", flags.text, "only this text; * matches any characters, ? any one character"));
  listing.push_back(&verb.add_flag(
      "--near", flags.near, "also match texts with one wrong, missing or additional character"));
  listing.push_back(&verb.add_option(
      "--since", flags.since,
      "seen at or after: 2024-05-01, 2024-05-01T12:30 (UTC), or 12h for twelve hours ago"));
  listing.push_back(
      &verb.add_option("--until", flags.until, "seen at or before; a date includes the whole day"));
  listing.push_back(
      &verb.add_option("--source", flags.source, "only this source, as named in the log"));
  listing.push_back(
      &verb.add_option("--limit", flags.limit, "maximum number of entries, newest first; 0: all")
           .check(at_least(0))
           .show_default());
  listing.push_back(&verb.add_option("--csv", flags.csv, "CSV file; - for stdout"));
  listing.push_back(&verb.add_option("--crops", flags.crops, "output folder for the plate crops"));
  Flag& keep = verb.add_option("--keep", flags.keep,
                               "delete entries last seen longer ago than: 30d, 12h, 90m ..");
  for (Flag* flag : listing) keep.excludes(*flag);
  flags.keep_flag = &keep;
  const auto group = [](Flag& flag) -> Flag& { return flag.group("Corrections"); };
  Flag& correct =
      group(verb.add_option("--correct", flags.correct,
                            "id of an entry and its correct text; the original reading is kept")
                .expected(2)
                .type_name("ID TEXT"));
  Flag& undo = group(verb.add_option("--undo-correction", flags.undo,
                                     "id of an entry whose last correction to undo [none]")
                         .check(at_least(1)));
  group(verb.add_option("--author", flags.author, "author of the correction [the user's name]")
            .needs(correct));
  Flag& corrections = group(
      verb.add_option("--corrections", flags.corrections,
                      "output folder for the corrected plates, as input of `plate train-reader`"));
  group(verb.add_option("--detector", flags.reader.detector_model,
                        "model that finds the corners of corrected plates [the shipped model]"))
      .needs(corrections);
  group(verb.add_option("--reader", flags.reader.reader_model,
                        "model that finds the characters of corrected plates [the shipped model]"))
      .needs(corrections);
  Flag* const works[] = {&keep, &correct, &undo, &corrections};
  for (Flag* one : works) {
    for (Flag* other : works) {
      if (one < other) one->excludes(*other);
    }
  }
  for (Flag* flag : listing) {
    correct.excludes(*flag);
    undo.excludes(*flag);
  }
}

}  // namespace

void add_plate_log(Command& plate, Context& context) {
  add_verb<PlateLogFlags>(
      plate, "log", "list, search, export and delete entries of `plate read --log`, newest first",
      context, add_flags, run_log);
}

}  // namespace tarsier::cli
