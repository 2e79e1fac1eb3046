// SPDX-License-Identifier: MIT
#include "tarsier/core/cpu.h"
#include "tarsier/core/log.h"
#include "tarsier/core/name_table.h"
#include "tarsier/face/onnx/module.h"
#include "tarsier/face/pipelines/detector_model.h"
#include "tarsier/face/pipelines/identifier.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/cameras.h"
#include "tarsier/media/model_store.h"
#include "tarsier/media/tls.h"
#include "tarsier/mqtt/connection.h"
#include "tarsier/mqtt/hub_postgres.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include "framework/cli.h"
#include "framework/parse.h"
#include "verbs/program/sample_images.h"
#include "window.h"
#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <microhttpd.h>
#include <nlohmann/json.hpp>
#include <optional>
#include <sys/socket.h>
#include <sys/un.h>
#include <system_error>
#include <thread>
#include <unistd.h>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

enum class Finding { kOk, kNote, kProblem };

struct Item {
  const char* area;  // "camera"
  std::string name;  // "V4L2"
  Finding finding = Finding::kOk;
  std::string value;   // the finding
  std::string advice;  // what to do; empty: nothing
};

constexpr NameTable<Finding, 3> kFindings{
    "finding", {{{Finding::kOk, "ok"}, {Finding::kNote, "note"}, {Finding::kProblem, "problem"}}}};

std::string_view name_of(Finding finding) { return kFindings.name(finding); }

// --- looking ---

// First line of a small text file of the system, without unprintable characters ("" if it cannot be
// read).
std::string first_line(const fs::path& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  std::erase_if(line, [](char c) { return static_cast<unsigned char>(c) < 0x20; });
  return line.substr(0, 200);
}

// The value of "key : value" lines (/proc/cpuinfo, /proc/meminfo).
std::string value_in(const char* path, std::string_view key) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    const size_t colon = line.find(':');
    if (colon == std::string::npos || !line.starts_with(key)) continue;
    const size_t start = line.find_first_not_of(" \t", colon + 1);
    return start == std::string::npos ? "" : line.substr(start);
  }
  return {};
}

std::string raspberry_pi_model() {
  const std::string model = first_line("/proc/device-tree/model");
  return model.starts_with("Raspberry Pi") ? model : std::string();
}

// Whether something listens on the local socket `path`; a path that begins with '@' is an abstract
// one.
bool socket_responds(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof address.sun_path) return false;
  std::copy(path.begin(), path.end(), address.sun_path);
  if (path.front() == '@') address.sun_path[0] = '\0';
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path.size());
  const int handle = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (handle < 0) return false;
  const bool responds = connect(handle, reinterpret_cast<const sockaddr*>(&address), length) == 0;
  close(handle);
  return responds;
}

// --- the findings ---

std::string compiler() {
#if defined(__clang__)
  return fmt::format("Clang {}.{}.{}", __clang_major__, __clang_minor__, __clang_patchlevel__);
#else
  return fmt::format("GCC {}.{}.{}", __GNUC__, __GNUC_MINOR__, __GNUC_PATCHLEVEL__);
#endif
}

void check_program(std::vector<Item>& items) {
#if defined(__OPTIMIZE__)
  items.push_back(
      {"program", "tarsier", Finding::kOk, fmt::format("{}, {}", version(), compiler()), ""});
#else
  items.push_back({"program", "tarsier", Finding::kNote,
                   fmt::format("{}, {}, built without optimisation", version(), compiler()),
                   "for speed: cmake --preset release && cmake --build --preset release"});
#endif
  const std::string built = CV_VERSION;
  const std::string runs = cv::getVersionString();
  items.push_back(
      {"program", "OpenCV", runs == built ? Finding::kOk : Finding::kNote,
       runs == built ? runs : fmt::format("{}, but tarsier was built with {}", runs, built),
       runs == built ? "" : "build tarsier again"});
  items.push_back({"program", "libraries", Finding::kOk,
                   fmt::format("fmt {}.{}.{}, nlohmann-json {}.{}.{}, CLI11 {}, libmicrohttpd {}",
                               FMT_VERSION / 10000, FMT_VERSION / 100 % 100, FMT_VERSION % 100,
                               NLOHMANN_JSON_VERSION_MAJOR, NLOHMANN_JSON_VERSION_MINOR,
                               NLOHMANN_JSON_VERSION_PATCH, parser_version(), MHD_get_version()),
                   ""});
}

void check_machine(std::vector<Item>& items) {
  const std::string board = raspberry_pi_model();
  std::string processor = value_in("/proc/cpuinfo", "model name");
  if (processor.empty()) processor = first_line("/proc/device-tree/model");
  if (processor.empty()) processor = "unknown";
  items.push_back({"machine", "processor", Finding::kOk, board.empty() ? processor : board, ""});

  const SimdLevel best = hardware_simd_level();
  const SimdLevel used = simd_level();
  const bool slow = used == SimdLevel::kBaseline && tarsier::name_of(used) == "baseline";
  items.push_back({"machine", "vectors", slow || used != best ? Finding::kNote : Finding::kOk,
                   used == best
                       ? std::string(tarsier::name_of(used))
                       : fmt::format("{} of {}", tarsier::name_of(used), tarsier::name_of(best)),
                   used != best ? "the environment variable TARSIER_SIMD limits it"
                   : slow ? "no vector instructions that Tarsier knows: live modes will be slow"
                          : ""});
  items.push_back({"machine", "OpenCV's", Finding::kOk, cv::getCPUFeaturesLine(), ""});

  const unsigned cores = std::max(1U, std::thread::hardware_concurrency());
  items.push_back(
      {"machine", "cores", cores > 1 ? Finding::kOk : Finding::kNote,
       fmt::format("{}, OpenCV uses {} threads", cores, cv::getNumThreads()),
       cores > 1 ? "" : "live work wants two or more: one draws while the other reads the camera"});

  constexpr double kGbPerKib = 1024 / 1e9;
  const double total = std::atof(value_in("/proc/meminfo", "MemTotal").c_str()) * kGbPerKib;
  const double free = std::atof(value_in("/proc/meminfo", "MemAvailable").c_str()) * kGbPerKib;
  if (total > 0) {
    items.push_back(
        {"machine", "memory", free < 0.3 ? Finding::kNote : Finding::kOk,
         fmt::format("{:.1f} GB, {:.1f} GB free", total, free),
         free < 0.3 ? "little is free: close other programs, or work at a smaller --size" : ""});
  }
  const std::string heat = first_line("/sys/class/thermal/thermal_zone0/temp");
  if (!board.empty() && !heat.empty()) {
    const double celsius = std::atof(heat.c_str()) / 1000;
    items.push_back(
        {"machine", "heat", celsius < 75 ? Finding::kOk : Finding::kNote,
         fmt::format("{:.0f} degrees C", celsius),
         celsius < 75 ? ""
                      : "above 80 degrees a Raspberry Pi slows down: give it a heat sink or fan"});
  }

  std::error_code error;
  const fs::path temp = fs::temp_directory_path(error);
  const fs::space_info space = error ? fs::space_info{} : fs::space(temp, error);
  if (error || access(temp.c_str(), W_OK) != 0) {
    items.push_back({"machine", "temp folder", Finding::kProblem,
                     fmt::format("{} cannot be used", temp.empty() ? "it" : temp.string()),
                     "set TMPDIR to a folder you may write to"});
  } else {
    const double gigabytes = static_cast<double>(space.available) / 1e9;
    const bool is_low = gigabytes < 0.5;
    items.push_back({"machine", "temp folder", is_low ? Finding::kProblem : Finding::kOk,
                     fmt::format("{}, {:.1f} GB free", temp.string(), gigabytes),
                     is_low ? "free some disk space there, or set TMPDIR to another disk" : ""});
  }
}

// The largest size of each pixel format that a camera offers, "MJPG 1920x1080 at 30, YUYV 640x480
// at 30 fps".
std::string modes_of(const CameraInfo& camera) {
  std::vector<const CameraMode*> best;
  for (const CameraMode& mode : camera.modes) {
    const auto same = std::find_if(best.begin(), best.end(), [&](const CameraMode* other) {
      return other->format == mode.format;
    });
    if (same == best.end()) {
      best.push_back(&mode);
    } else if (mode.width * mode.height > (*same)->width * (*same)->height) {
      *same = &mode;
    }
  }
  std::string text;
  for (const CameraMode* mode : best) {
    text += fmt::format("{}{} {}x{}", text.empty() ? "" : ", ", mode->format, mode->width,
                        mode->height);
    if (!mode->fps.empty()) text += fmt::format(" at {:g}", mode->fps.front());
  }
  return text.empty() ? "no modes stated" : text;
}

void check_cameras(std::vector<Item>& items, const std::vector<CameraInfo>& cameras) {
  for (const CameraInfo& camera : cameras) {
    if (camera.error.empty()) {
      items.push_back({"cameras", camera.path, Finding::kOk,
                       fmt::format("{}: {}", camera.card, modes_of(camera)),
                       fmt::format("tarsier cartoon run {} --window",
                                   camera.links.empty() ? camera.path : camera.links.front())});
    } else {
      items.push_back({"cameras", camera.path, Finding::kProblem, camera.error,
                       "often: sudo usermod -aG video $USER, then log in again"});
    }
  }
  if (cameras.empty()) {
    items.push_back({"cameras", "V4L2", Finding::kNote, "none found",
                     "plug in a USB camera, use a network camera's URL, or try synth:scene"});
  }
  try {
    const TlsTrust trust(StreamSecurity{});
    items.push_back({"cameras", "https, rtsps", Finding::kOk, "the system's authorities are there",
                     "a camera with a certificate of its own: --ca-file FILE"});
  } catch (const Error& error) {
    items.push_back({"cameras", "https, rtsps", Finding::kNote, error.what(),
                     "sudo apt install ca-certificates, or --ca-file FILE"});
  }
  std::string tool = find_program_on_path("rpicam-vid");
  if (tool.empty()) tool = find_program_on_path("libcamera-vid");
  const bool on_pi = !raspberry_pi_model().empty();
  if (!tool.empty()) {
    items.push_back(
        {"cameras", "picam:", Finding::kOk, tool, "tarsier cartoon run picam: --window"});
  } else {
    items.push_back(
        {"cameras", "picam:", Finding::kNote,
         on_pi ? "rpicam-vid is not installed" : "no Raspberry Pi, so no camera module",
         on_pi ? "for the camera module: sudo apt install rpicam-apps (Raspberry Pi OS)" : ""});
  }
}

// Reports what DISPLAY means ("screen 0 of this machine") and whether a display answers there.
void check_display(std::vector<Item>& items) {
  try {
    window::prepare();
    items.push_back({"display", "--window", Finding::kOk, "ready", ""});
  } catch (const Error& error) {
    items.push_back({"display", "--window", Finding::kNote, error.what(),
                     "all works without: -o FILE, or -o http://127.0.0.1:8080/ and a browser"});
  }
  const char* wayland = std::getenv("WAYLAND_DISPLAY");
  const char* runtime = std::getenv("XDG_RUNTIME_DIR");
  if (wayland != nullptr && *wayland != '\0') {
    const std::string path = *wayland == '/' || runtime == nullptr
                                 ? std::string(wayland)
                                 : (fs::path(runtime) / wayland).string();
    const bool responds = socket_responds(path);
    items.push_back({"display", "Wayland", responds ? Finding::kOk : Finding::kNote,
                     fmt::format("{} {}", wayland, responds ? "answers" : "does not answer"),
                     responds ? "" : "unset WAYLAND_DISPLAY, or log in on the desktop"});
  }
  const char* x11 = std::getenv("DISPLAY");
  if (x11 != nullptr && *x11 != '\0') {
    const std::string_view display = x11;
    const size_t colon = display.rfind(':');
    const bool local = colon == 0 || display.starts_with("unix:");
    const std::string number(colon == std::string_view::npos
                                 ? ""
                                 : display.substr(colon + 1, display.find('.', colon) - colon - 1));
    const std::string socket = "/tmp/.X11-unix/X" + number;
    const bool responds = local && (socket_responds(socket) || socket_responds('@' + socket));
    items.push_back({"display", "X11", responds || !local ? Finding::kOk : Finding::kNote,
                     fmt::format("{} {}", x11,
                                 !local     ? "(over the network, not tried)"
                                 : responds ? "answers"
                                            : "does not answer"),
                     responds || !local
                         ? ""
                         : "set DISPLAY to the screen's (often :0), or log in on the desktop"});
  }
  if ((wayland == nullptr || *wayland == '\0') && (x11 == nullptr || *x11 == '\0')) {
    items.push_back(
        {"display", "screen", Finding::kNote, "none: DISPLAY and WAYLAND_DISPLAY are not set",
         "log in on the desktop, or do without: -o http://127.0.0.1:8080/ and a browser"});
  }
}

int count_files(const fs::path& folder, const std::vector<std::string>& endings) {
  int count = 0;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (std::find(endings.begin(), endings.end(), entry.path().extension()) != endings.end())
      ++count;
  }
  return count;
}

// Names of the models whose terms are narrower than the program's MIT licence, by their terms.
// `models verify` reports models that cannot be read.
std::map<std::string, std::string> restricted_models(const std::string& folder) {
  std::map<std::string, std::string> names_by_terms;
  std::vector<fs::path> paths;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (entry.path().extension() == ".json") paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  for (const fs::path& path : paths) {
    std::string terms;
    try {
      const json provenance = read_any_archive(path.string()).provenance;
      terms = provenance.value("terms", "not stated");
    } catch (const std::exception&) {
      continue;
    }
    const bool research = terms.find("non-commercial") != std::string::npos;
    const bool database = terms.find("ODbL") != std::string::npos;
    if (!research && !database && terms != "not stated") continue;
    std::string& names = names_by_terms[research   ? "non-commercial research only"
                                        : database ? "in part from ODbL data"
                                                   : "terms not stated"];
    names += (names.empty() ? "" : ", ") + path.stem().string();
  }
  return names_by_terms;
}

void check_terms(std::vector<Item>& items, const std::string& folder) {
  if (folder.empty()) return;
  for (const auto& [terms, names] : restricted_models(folder)) {
    items.push_back({"data", "model terms", Finding::kOk, fmt::format("{}: {}", terms, names),
                     "tarsier models list tells who uses them, and how to do without"});
  }
}

void check_data(std::vector<Item>& items) {
  int cascades = 0;
  std::string cascade_folder;
  for (const char* folder : {"/usr/share/opencv4/haarcascades", "/usr/share/opencv/haarcascades",
                             "/usr/local/share/opencv4/haarcascades"}) {
    if (cascades = count_files(folder, {".xml"}); cascades > 0) {
      cascade_folder = folder;
      break;
    }
  }
  items.push_back({"data", "face cascades", cascades > 0 ? Finding::kOk : Finding::kNote,
                   cascades > 0 ? fmt::format("{} in {}", cascades, cascade_folder) : "not found",
                   cascades > 0 ? "" : "for --face auto: sudo apt install opencv-data"});

  const int samples = count_files(std::string(kSampleImages), {".jpg", ".png", ".avi"});
  items.push_back({"data", "sample images", samples > 0 ? Finding::kOk : Finding::kNote,
                   samples > 0 ? fmt::format("{} in {}", samples, kSampleImages) : "not found",
                   samples > 0 ? "" : "for a nicer demo: sudo apt install opencv-doc"});

  try {
    const std::string folder = find_models_folder("");
    const int models = folder.empty() ? 0 : count_files(folder, {".json"});
    items.push_back({"data", "models", Finding::kOk,
                     folder.empty() ? "none, and none is needed"
                     : models == 0  ? fmt::format("none in {}, and none is needed", folder)
                                    : fmt::format("{} in {}", models, folder),
                     models > 0 ? "tarsier models list" : ""});
    check_terms(items, folder);
    const ModelStore store = ModelStore::find();
    const bool deep = face::has_deep_templates(store);
    items.push_back({"data", "face network", deep ? Finding::kOk : Finding::kNote,
                     deep ? store.expected_path("face-embedding.json")
                          : "not installed: people are compared by classic templates",
                     deep ? "`people train --template deep` computes a gallery's templates with it"
                          : "deep templates know many more faces in the wild: "
                            "scripts/get-model.sh face-embedding (6 MB, MIT)"});
    const std::string onnx = face::onnx::module_path();
    items.push_back({"data", "own networks", onnx.empty() ? Finding::kNote : Finding::kOk,
                     onnx.empty() ? "no module that runs ONNX files is installed" : onnx,
                     onnx.empty() ? "for people --embedding FILE.onnx: the package tarsier-onnx"
                                  : "people --embedding FILE.onnx; tarsier models info FILE.onnx "
                                    "tells its SHA-256 and licence"});
    const bool anchors = face::has_anchor_detector(store);
    items.push_back({"data", "face detector", anchors ? Finding::kOk : Finding::kNote,
                     anchors ? store.expected_path(face::kAnchorDetectorFile)
                             : "only the one that ships is installed",
                     anchors ? "it works beside the one that ships"
                             : "another beside it finds more faces with sunglasses, caps and "
                               "beards: scripts/get-model.sh face-detector (190 kB, MIT)"});
  } catch (const Error& error) {
    items.push_back(
        {"data", "models", Finding::kProblem, error.what(), "correct or unset TARSIER_MODELS"});
  }

  const char* data = std::getenv("TARSIER_DATA");
  std::error_code error;
  const bool found = data != nullptr && fs::is_directory(data, error);
  if (data != nullptr) {
    items.push_back(
        {"data", "test data", found ? Finding::kOk : Finding::kNote,
         fmt::format("{}{}", data, found ? "" : " is not a folder"),
         found ? "" : "only tests of Tarsier itself need it: scripts/get-data.sh list"});
  }
}

void check_mqtt(std::vector<Item>& items) {
  std::string reason;
  const std::string library = mqtt::library_version(reason);
  const std::size_t colon = reason.find(": ");
  items.push_back(
      {"network", "MQTT", library.empty() ? Finding::kNote : Finding::kOk,
       library.empty() ? reason.substr(0, colon) : "libmosquitto " + library,
       library.empty() ? "for --publish and `tarsier hub`: " + reason.substr(colon + 2) : ""});
  std::string broker = find_program_on_path("mosquitto");
  if (broker.empty() && ::access("/usr/sbin/mosquitto", X_OK) == 0) broker = "/usr/sbin/mosquitto";
  items.push_back({"network", "mosquitto", broker.empty() ? Finding::kNote : Finding::kOk,
                   broker.empty() ? "no broker on this machine" : broker,
                   broker.empty() ? "cameras may publish to another machine's; for one here: sudo "
                                    "apt install mosquitto"
                                  : ""});
  const std::string libpq = mqtt::libpq_version(reason);
  items.push_back(
      {"network", "PostgreSQL", libpq.empty() ? Finding::kNote : Finding::kOk,
       libpq.empty() ? "libpq is not installed" : "libpq " + libpq,
       libpq.empty() ? "for `tarsier hub --log postgresql://..`: sudo apt install libpq5" : ""});
}

// --- showing ---

// `text` in lines of at most `width` characters, broken at spaces; all lines except the first begin
// with `indent`.
std::string wrapped(const std::string& text, size_t width, const std::string& indent) {
  std::string result;
  size_t column = 0;
  size_t at = 0;
  while (at < text.size()) {
    const size_t end = std::min(text.find(' ', at), text.size());
    if (column > 0 && column + 1 + (end - at) > width) {
      result += '\n' + indent;
      column = 0;
    } else if (column > 0) {
      result += ' ';
      ++column;
    }
    result += text.substr(at, end - at);
    column += end - at;
    at = end + 1;
  }
  return result;
}

void print_text_report(const std::vector<Item>& items) {
  const bool colour = isatty(STDOUT_FILENO) != 0 && std::getenv("NO_COLOR") == nullptr;
  const auto painted = [colour](Finding finding) {
    const char* text = finding == Finding::kOk     ? "ok     "
                       : finding == Finding::kNote ? "note   "
                                                   : "PROBLEM";
    const int code = finding == Finding::kOk ? 32 : finding == Finding::kNote ? 33 : 31;
    return colour ? fmt::format("\x1b[{}m{}\x1b[0m", code, text) : std::string(text);
  };
  std::string text = fmt::format("tarsier {} on this machine\n", version());
  std::string_view area;
  for (const Item& item : items) {
    if (area != item.area) {
      area = item.area;
      text += fmt::format("\n{}{}{}\n", colour ? "\x1b[1m" : "", area, colour ? "\x1b[0m" : "");
    }
    const std::string indent(27, ' ');
    text += fmt::format("  {} {:<16} {}\n", painted(item.finding), printable(item.name),
                        wrapped(printable(item.value), 73, indent));
    if (!item.advice.empty()) {
      text += fmt::format("{}-> {}\n", indent, wrapped(printable(item.advice), 70, indent + "   "));
    }
  }
  const auto count = [&items](Finding finding) {
    return std::count_if(items.begin(), items.end(),
                         [&](const Item& i) { return i.finding == finding; });
  };
  const auto problems = count(Finding::kProblem);
  const auto notes = count(Finding::kNote);
  text += problems > 0 ? fmt::format("\n{} problem{}, {} note{}: follow the arrows.\n", problems,
                                     problems == 1 ? "" : "s", notes, notes == 1 ? "" : "s")
                       : fmt::format("\nReady: no problems, {} note{}. Try: tarsier demo\n", notes,
                                     notes == 1 ? "" : "s");
  print_text(text);
}

json camera_json(const CameraInfo& camera) {
  json modes = json::array();
  for (const CameraMode& mode : camera.modes) {
    modes.push_back({{"format", mode.format},
                     {"width", mode.width},
                     {"height", mode.height},
                     {"fps", mode.fps}});
  }
  return {{"path", camera.path},     {"links", camera.links}, {"card", camera.card},
          {"driver", camera.driver}, {"bus", camera.bus},     {"modes", modes},
          {"trouble", camera.error}};
}

void print_findings(const std::vector<Item>& items, const std::vector<CameraInfo>& found) {
  json list = json::array();
  int problems = 0;
  for (const Item& item : items) {
    problems += item.finding == Finding::kProblem ? 1 : 0;
    list.push_back({{"area", item.area},
                    {"name", item.name},
                    {"finding", name_of(item.finding)},
                    {"value", item.value},
                    {"advice", item.advice}});
  }
  json cameras = json::array();
  for (const CameraInfo& camera : found) cameras.push_back(camera_json(camera));
  print_json(json{{"version", version()},
                  {"opencv", cv::getVersionString()},
                  {"compiler", compiler()},
                  {"simd", tarsier::name_of(simd_level())},
                  {"cores", std::max(1U, std::thread::hardware_concurrency())},
                  {"cameras", std::move(cameras)},
                  {"problems", problems},
                  {"items", std::move(list)}});
}

ExitStatus run_doctor(const Context& context) {
  std::vector<Item> items;
  check_program(items);
  check_machine(items);
  const std::vector<CameraInfo> cameras = list_cameras();
  check_cameras(items, cameras);
  check_display(items);
  check_data(items);
  check_mqtt(items);
  if (context.json) {
    print_findings(items, cameras);
  } else {
    print_text_report(items);
  }
  const bool sound = std::none_of(items.begin(), items.end(),
                                  [](const Item& i) { return i.finding == Finding::kProblem; });
  return sound ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

}  // namespace

void add_doctor(Command& app, Context& context) {
  Command& verb =
      app.add_subcommand("doctor", "check what this machine has and lacks, with advice");
  add_common_flags(verb, context);
  set_run(verb, context, [&context] { return run_doctor(context); });
}

}  // namespace tarsier::cli
