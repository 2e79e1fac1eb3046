// SPDX-License-Identifier: MIT
#include "tarsier/media/cameras.h"

#include "tarsier/core/errors.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <functional>
#include <linux/videodev2.h>
#include <optional>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxModes = 256;  // limit for drivers whose enumeration never ends

class Device {
 public:
  explicit Device(const std::string& path)
      : descriptor_(::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC)), error_(errno) {}
  ~Device() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  [[nodiscard]] bool is_open() const { return descriptor_ >= 0; }
  [[nodiscard]] int error() const { return error_; }
  template <typename Argument>
  [[nodiscard]] bool ask(unsigned long request, Argument& argument) const {
    int result = 0;
    do {
      result = ::ioctl(descriptor_, request, &argument);
    } while (result < 0 && errno == EINTR);
    return result == 0;
  }

 private:
  int descriptor_;
  int error_;
};

template <std::size_t Size>
std::string text_of(const __u8 (&bytes)[Size]) {
  const auto* text = reinterpret_cast<const char*>(bytes);
  return {text, ::strnlen(text, Size)};
}

std::string four_characters(__u32 code) {
  std::string text;
  for (unsigned shift = 0; shift < 32; shift += 8) {
    const auto c = static_cast<char>((code >> shift) & 0x7fU);
    text += c >= 0x20 && c < 0x7f ? c : '?';
  }
  while (!text.empty() && text.back() == ' ') text.pop_back();
  return text;
}

__u32 capabilities_of(const v4l2_capability& capability) {
  return (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? capability.device_caps
                                                               : capability.capabilities;
}

bool captures(const v4l2_capability& capability) {
  return (capabilities_of(capability) & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE)) !=
         0;
}

std::vector<double> frame_rates(const Device& device, __u32 format, __u32 width, __u32 height) {
  std::vector<double> rates;
  v4l2_frmivalenum interval{};
  interval.pixel_format = format;
  interval.width = width;
  interval.height = height;
  for (; interval.index < 64 && device.ask(VIDIOC_ENUM_FRAMEINTERVALS, interval);
       ++interval.index) {
    const bool is_discrete = interval.type == V4L2_FRMIVAL_TYPE_DISCRETE;
    const v4l2_fract period = is_discrete ? interval.discrete : interval.stepwise.min;
    if (period.numerator > 0)
      rates.push_back(static_cast<double>(period.denominator) / period.numerator);
    if (!is_discrete) break;
  }
  std::sort(rates.begin(), rates.end(), std::greater<>());
  return rates;
}

std::vector<CameraMode> modes_of(const Device& device, __u32 type) {
  std::vector<CameraMode> modes;
  v4l2_fmtdesc format{};
  format.type = type;
  for (; format.index < 64 && device.ask(VIDIOC_ENUM_FMT, format); ++format.index) {
    v4l2_frmsizeenum size{};
    size.pixel_format = format.pixelformat;
    for (; size.index < 128 && device.ask(VIDIOC_ENUM_FRAMESIZES, size); ++size.index) {
      if (modes.size() >= kMaxModes) return modes;
      const bool is_discrete = size.type == V4L2_FRMSIZE_TYPE_DISCRETE;
      const __u32 width = is_discrete ? size.discrete.width : size.stepwise.max_width;
      const __u32 height = is_discrete ? size.discrete.height : size.stepwise.max_height;
      CameraMode mode;
      mode.format = four_characters(format.pixelformat);
      mode.width = static_cast<int>(width);
      mode.height = static_cast<int>(height);
      mode.fps = frame_rates(device, format.pixelformat, width, height);
      modes.push_back(std::move(mode));
      if (!is_discrete) break;
    }
  }
  return modes;
}

std::optional<int> number_of(const std::string& name) {
  static constexpr std::string_view kPrefix = "video";
  if (!name.starts_with(kPrefix)) return std::nullopt;
  int number = 0;
  const char* begin = name.data() + kPrefix.size();
  const char* end = name.data() + name.size();
  const auto result = std::from_chars(begin, end, number);
  if (result.ec != std::errc() || result.ptr != end) return std::nullopt;
  return number;
}

std::vector<std::string> links_to(const fs::path& device) {
  std::vector<std::string> links;
  for (const char* folder : {"/dev/v4l/by-id", "/dev/v4l/by-path"}) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error)) {
      std::error_code ignored;
      if (fs::canonical(entry.path(), ignored) == device) links.push_back(entry.path().string());
    }
  }
  std::sort(links.begin(), links.end());
  return links;
}

}  // namespace

std::vector<CameraInfo> list_cameras() {
  std::vector<std::pair<int, std::string>> devices;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/dev", error)) {
    if (const auto number = number_of(entry.path().filename().string())) {
      devices.emplace_back(*number, entry.path().string());
    }
  }
  std::sort(devices.begin(), devices.end());
  std::vector<CameraInfo> cameras;
  for (const auto& [number, path] : devices) {
    CameraInfo camera;
    camera.path = path;
    const Device device(path);
    if (!device.is_open()) {
      camera.error = camera_error(path);
      if (device.error() != EACCES && device.error() != EBUSY) continue;
      cameras.push_back(std::move(camera));
      continue;
    }
    v4l2_capability capability{};
    if (!device.ask(VIDIOC_QUERYCAP, capability) || !captures(capability)) continue;
    camera.card = text_of(capability.card);
    camera.driver = text_of(capability.driver);
    camera.bus = text_of(capability.bus_info);
    const bool is_planar = (capabilities_of(capability) & V4L2_CAP_VIDEO_CAPTURE) == 0;
    camera.modes = modes_of(
        device, is_planar ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE);
    camera.links = links_to(path);
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

std::string camera_error(const std::string& path) {
  const Device device(path);
  if (!device.is_open()) {
    switch (device.error()) {
      case ENOENT:
      case ENODEV:
      case ENXIO:
        return fmt::format("no such device ({}); `tarsier doctor` lists cameras", path);
      case EACCES:
      case EPERM:
        return fmt::format(
            "no permission for {}; add yourself to the group video (sudo usermod -aG video $USER) "
            "and log in again",
            path);
      case EBUSY:
        return fmt::format("{} is in use by another program", path);
      default:
        return fmt::format("{}: {}", path, errno_text(device.error()));
    }
  }
  v4l2_capability capability{};
  if (!device.ask(VIDIOC_QUERYCAP, capability)) {
    return fmt::format("{} is not a camera; `tarsier doctor` lists cameras", path);
  }
  if (!captures(capability)) {
    return fmt::format("{} ({}) does not capture video; `tarsier doctor` lists cameras", path,
                       text_of(capability.card));
  }
  return {};
}

std::string find_program_on_path(std::string_view name) {
  const char* variable = std::getenv("PATH");  // NOLINT(concurrency-mt-unsafe)
  std::string_view folders = variable != nullptr ? variable : "/usr/local/bin:/usr/bin:/bin";
  while (!folders.empty()) {
    const std::size_t colon = std::min(folders.find(':'), folders.size());
    const std::string_view folder = folders.substr(0, colon);
    folders.remove_prefix(std::min(colon + 1, folders.size()));
    if (folder.empty()) continue;  // the current folder: never
    std::string path = fmt::format("{}/{}", folder, name);
    struct stat status {};
    if (::stat(path.c_str(), &status) == 0 && S_ISREG(status.st_mode) &&
        ::access(path.c_str(), X_OK) == 0) {
      return path;
    }
  }
  return {};
}

}  // namespace tarsier
