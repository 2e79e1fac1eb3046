// SPDX-License-Identifier: MIT
#include "verbs/plate/site.h"

#include "tarsier/core/log.h"
#include "tarsier/media/model_store.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include "framework/bind.h"
#include "framework/flag_info.h"
#include "framework/input_schemes.h"
#include "framework/output.h"
#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>
#include <utility>

namespace tarsier::cli {
namespace {

bool is_live(const std::string& source, const SourceOptions& options,
             const std::vector<Scheme>& schemes) {
  switch (classify_source(source, schemes)) {
    case SourceKind::kCamera:
    case SourceKind::kPiCamera:
    case SourceKind::kHttp:
    case SourceKind::kFfmpegUrl:
      return true;
    case SourceKind::kScheme:
      return source.starts_with("synth:") && open_source(source, options, schemes)->is_live();
    default:
      return false;
  }
}

// Splits "gate=rtsp://..". The name is empty if `text` has none, or is a file.
NamedSource split_source(const std::string& text) {
  const std::size_t equals = text.find('=');
  std::error_code ignored;
  if (equals == std::string::npos || equals == 0 || std::filesystem::exists(text, ignored))
    return {"", text};
  const std::string name = text.substr(0, equals);
  return mqtt::is_node_name(name) ? NamedSource{name, text.substr(equals + 1)}
                                  : NamedSource{"", text};
}

void check_single_source_flags(const RunFlags& run) {
  if (!run.output.empty() && run.output != "none")
    throw UsageError("-o: images cannot be written for several cameras; omit it");
  if (run.window || run.fullscreen || run.frames > 0 || run.every != 1 || !run.actions.empty() ||
      run.source.sequence || run.batch.is_requested())
    throw UsageError(
        "--window, --frames, --every, --actions, --sequence and --shard need a single source: not "
        "possible with several cameras");
}

std::map<std::string, plate::Region> regions_of(const std::vector<std::string>& words,
                                                const std::vector<NamedSource>& cameras) {
  std::map<std::string, plate::Region> regions;
  for (const std::string& word : words) {
    const std::size_t equals = word.find('=');
    const std::string name = word.substr(0, equals);
    const bool known = std::any_of(cameras.begin(), cameras.end(),
                                   [&](const NamedSource& camera) { return camera.name == name; });
    if (equals == std::string::npos || !known) {
      throw UsageError(fmt::format("--camera-roi {}: expected NAME=x,y,w,h of one of the cameras",
                                   printable(word)));
    }
    regions[name] = plate::parse_region(word.substr(equals + 1));
  }
  return regions;
}

nlohmann::ordered_json json_of(const plate::CameraReport& report) {
  return {{"camera", report.name},
          {"received", report.received},
          {"looked_at", report.examined},
          {"moving", report.moving},
          {"read", report.read},
          {"in_part", report.read_partially},
          {"vehicles", report.vehicles},
          {"restarts", report.restarts},
          {"cpu_s", rounded(report.cpu_s, 3)}};
}

void print_reports(const std::vector<plate::CameraReport>& reports, const Context& context) {
  if (context.json) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    for (const plate::CameraReport& report : reports) list.push_back(json_of(report));
    print_json({{"cameras", std::move(list)}});
    return;
  }
  for (const plate::CameraReport& report : reports) {
    log_info(
        "{}: {} frames received, {} checked for motion, {} with motion, {} read in {:.1f} CPU s; "
        "{} vehicles, {} restarts",
        report.name, report.received, report.examined, report.moving, report.read, report.cpu_s,
        report.vehicles, report.restarts);
  }
}

}  // namespace

void add_site_flags(Command& verb, SiteFlags& flags) {
  constexpr const char* kGroup = "Several cameras";
  flags.bound.push_back(&verb.add_option("--camera-roi", flags.regions,
                                         "--roi of one camera, NAME=x,y,w,h; one for each camera")
                             .one_value_each()
                             .group(kGroup));
  for (const OptionField& field : flags.options.fields())
    if (!field.flag.empty()) flags.bound.push_back(&add_field(verb, field).group(kGroup));
  flags.bound.push_back(
      &bind_field(verb, flags.options.motion, flags.options.motion.threshold).group(kGroup));
}

void check_no_site_flags(const SiteFlags& flags) {
  for (const Flag* flag : flags.bound) {
    if (flag->count() == 0) continue;
    throw UsageError(fmt::format("{}: needs several cameras, or one with a name (NAME=SOURCE)",
                                 flag->describe().names.front()));
  }
}

std::vector<NamedSource> site_cameras(const RunFlags& run) {
  const std::vector<Scheme> schemes = input_schemes();
  std::vector<NamedSource> cameras;
  std::set<std::string> names;
  std::size_t live = 0;
  bool is_named = false;
  for (const std::string& input : run.inputs) {
    NamedSource camera = split_source(input);
    const bool named = !camera.name.empty();
    const bool lives = is_live(camera.source, run.source, schemes);
    if (named && !lives)
      throw UsageError(fmt::format("{}: NAME=SOURCE names cameras and streams", masked(input)));
    is_named = is_named || named;
    live += lives ? 1 : 0;
    if (!named) camera.name = masked(camera.source);
    if (lives && !names.insert(camera.name).second && (run.inputs.size() > 1))
      throw UsageError(fmt::format("{}: two cameras of one name; write NAME=SOURCE", camera.name));
    cameras.push_back(std::move(camera));
  }
  if (!is_named && live < 2) return {};
  if (live < cameras.size())
    throw UsageError("cameras and files cannot be combined: read the files in a separate run");
  return cameras;
}

ExitStatus read_site(const std::vector<NamedSource>& cameras, const SiteFlags& flags,
                     const RunFlags& run, const PlateFlags& plates,
                     const plate::TrackerOptions& tracker, const ReportFlags& reporting,
                     Context& context) {
  check_single_source_flags(run);
  const std::map<std::string, plate::Region> regions = regions_of(flags.regions, cameras);
  SourceOptions source = run.source;
  source.wait = true;  // for each camera separately
  source.give_up_s = 0;
  plate::SiteOptions options = flags.options;
  options.threads = context.threads > 0
                        ? context.threads
                        : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  cv::setNumThreads(1);  // the reading threads share the cores already
  plate::ReaderOptions reading = reader_options(plates, context);
  reading.recognizer.parallel = false;
  const auto reader =
      std::make_shared<const plate::Reader>(plate::Reader::load(ModelStore::find(), reading));
  UnsuitablePlateCounter unfit;
  std::mutex unfit_mutex;
  std::vector<plate::SiteCamera> all;
  for (const NamedSource& camera : cameras) {
    plate::TrackerOptions own = tracker;
    if (const auto region = regions.find(camera.name); region != regions.end())
      own.region = region->second;
    const plate::VideoReader::ReadPart read = [&, reader, region = own.region](
                                                  const Frame& frame, const cv::Rect& where,
                                                  DebugSink* debug) {
      plate::ReaderResult result = reader->process(frame, debug, nullptr, where);
      std::erase_if(result.plates, [&](const plate::Reading& plate) {
        return !region.contains_center(plate.box, frame.image.size());
      });
      const std::lock_guard lock(unfit_mutex);
      unfit.add(result.plates);
      return result;
    };
    all.push_back(
        {camera.name,
         [text = camera.source, source] { return open_source(text, source, input_schemes()); },
         {read, own}});
  }

  PlateReports reports(reporting, run, context);
  plate::SiteHandlers handlers;
  handlers.moment = [&](const Frame& frame) {
    reports.check();
    return reports.site_moment_of(frame);
  };
  handlers.events = [&](std::size_t, const std::vector<plate::PlateEvent>& events) {
    for (const plate::PlateEvent& event : events) reports.report_vehicle(event);
  };
  handlers.source = [&](std::size_t camera, const SourceStatus& status) {
    const std::string& name = cameras[camera].name;
    if (context.json) {
      print_json({{"source", name_of(status.state)}, {"detail", status.detail}, {"camera", name}});
    } else {
      log_info("{}: {} {}", name, name_of(status.state), status.detail);
    }
  };
  try {
    print_reports(plate::run_site(all, options, handlers, context.stop), context);
  } catch (...) {
    reports.finish(true);
    throw;
  }
  const bool interrupted = context.stop.stop_requested();
  reports.finish(interrupted);
  unfit.warn(plates.reader.countries);
  if (interrupted) return ExitStatus::kInterrupted;
  return reports.has_closed_events() ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

}  // namespace tarsier::cli
