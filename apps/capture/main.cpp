// SPDX-License-Identifier: MIT
//
// tarsier-capture: holds one camera or stream for tarsier in a separate process, which can be
// killed if a driver or FFmpeg blocks for ever. tarsier starts it, not people:
//   tarsier-capture v4l2 DEVICE WIDTH HEIGHT FPS     records to stdout
//                                                    (tarsier/media/capture_protocol.h)
//   tarsier-capture ffmpeg verify|insecure CA_FILE   the same for the address in
//                                                    $TARSIER_CAPTURE_URL; an empty CA_FILE means
//                                                    the system's authorities
//   tarsier-capture exec PROGRAM [ARGUMENT..]        becomes PROGRAM, but ends with tarsier
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/capture_protocol.h"
#include "tarsier/media/http_protocol.h"
#include "tarsier/media/tls_tunnel.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <sys/prctl.h>
#include <system_error>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

namespace {

using tarsier::CaptureRecord;

// Blocks; ends the program when nobody reads any more.
void write_all(const void* data, std::size_t size) {
  const auto* bytes = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t count = ::write(STDOUT_FILENO, bytes, size);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) ::_exit(0);
    bytes += count;
    size -= static_cast<std::size_t>(count);
  }
}

void write_text(CaptureRecord::Kind kind, std::string_view text, double fps = 0) {
  text = text.substr(0, CaptureRecord::kMaxText);
  if (text.empty()) return;
  CaptureRecord record;
  record.kind = kind;
  record.fps = fps;
  record.length = text.size();
  write_all(&record, sizeof record);
  write_all(text.data(), text.size());
}

// Ends the program, but not through exit(), because a hanging grab would block that.
[[noreturn]] void fail(std::string_view reason) {
  write_text(CaptureRecord::Kind::kError, reason);
  ::_exit(3);
}

// Passes the newest frame from the thread that grabs to the one that writes.
struct Slot {
  std::mutex mutex;
  std::condition_variable wake;
  cv::Mat image;
  std::int64_t time_ns = 0;
  std::uint32_t frames = 0;
  bool ended = false;
};

void grab(cv::VideoCapture& capture, Slot& slot) {
  constexpr int kMaxFailures = 5;  // tolerates single bad frames of USB cameras
  int failures = 0;
  while (failures < kMaxFailures) {
    if (!capture.grab()) {
      ++failures;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      continue;
    }
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    cv::Mat image;  // a new one each time: the writer may still hold the last one
    if (!capture.retrieve(image) || image.empty()) {
      ++failures;
      continue;
    }
    if (image.type() == CV_8UC1) cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
    if (image.type() != CV_8UC3) break;
    if (!image.isContinuous()) image = image.clone();
    failures = 0;
    const std::lock_guard lock(slot.mutex);
    slot.image = std::move(image);
    slot.time_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
    ++slot.frames;
    slot.wake.notify_one();
  }
  const std::lock_guard lock(slot.mutex);
  slot.ended = true;
  slot.wake.notify_one();
}

[[noreturn]] void forward_frames(cv::VideoCapture& capture, const char* end_message) {
  Slot slot;
  std::thread(grab, std::ref(capture), std::ref(slot)).detach();
  while (true) {
    CaptureRecord record;
    cv::Mat image;
    {
      std::unique_lock lock(slot.mutex);
      slot.wake.wait(lock, [&] { return !slot.image.empty() || slot.ended; });
      if (slot.image.empty()) break;
      image = std::exchange(slot.image, cv::Mat());
      record.time_ns = slot.time_ns;
      record.frames = std::exchange(slot.frames, 0U);
    }
    record.width = image.cols;
    record.height = image.rows;
    record.type = image.type();
    record.length = image.total() * image.elemSize();
    write_all(&record, sizeof record);
    write_all(image.data, static_cast<std::size_t>(record.length));
  }
  fail(end_message);
}

std::string fourcc_text(double value) {
  const int code = std::isfinite(value) ? static_cast<int>(value) : 0;
  std::string text;
  for (int shift = 0; shift < 32; shift += 8) {
    const auto c = static_cast<char>((code >> shift) & 0x7f);
    if (c > 0x20 && c < 0x7f) text += c;
  }
  return text;
}

void write_stream_info(const cv::VideoCapture& capture) {
  double fps = capture.get(cv::CAP_PROP_FPS);
  if (!std::isfinite(fps) || fps <= 0 || fps > 1000) fps = 0;
  std::string text = fmt::format("{:.0f}x{:.0f} {}", capture.get(cv::CAP_PROP_FRAME_WIDTH),
                                 capture.get(cv::CAP_PROP_FRAME_HEIGHT),
                                 fourcc_text(capture.get(cv::CAP_PROP_FOURCC)));
  if (fps > 0) text += fmt::format(" {:.4g} fps", fps);
  write_text(CaptureRecord::Kind::kInfo, text, fps);
}

double number_or_zero(std::string_view text) {
  double value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  return result.ec == std::errc() && std::isfinite(value) && value > 0 ? value : 0;
}

[[noreturn]] void run_camera(const std::vector<std::string>& words) {
  // OpenCV needs the device node itself, not a link to it.
  std::error_code error;
  const auto node = std::filesystem::canonical(words[0], error);
  const std::string path = error ? words[0] : node.string();
  static constexpr std::string_view kPrefix = "/dev/video";
  int index = -1;
  if (path.starts_with(kPrefix)) {
    std::from_chars(path.data() + kPrefix.size(), path.data() + path.size(), index);
  }
  static cv::VideoCapture capture;  // static: the grabbing thread is never joined
  const bool is_open =
      index >= 0 ? capture.open(index, cv::CAP_V4L2) : capture.open(path, cv::CAP_V4L2);
  if (!is_open) fail(fmt::format("cannot be opened ({}); is another program using it?", path));
  const double width = number_or_zero(words[1]);
  const double height = number_or_zero(words[2]);
  const double fps = number_or_zero(words[3]);
  // USB 2 is too slow for large uncompressed frames at a useful rate.
  if (width * height > 640 * 480 || fps > 30) {
    capture.set(cv::CAP_PROP_FOURCC, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'));
  }
  if (width > 0) capture.set(cv::CAP_PROP_FRAME_WIDTH, width);
  if (height > 0) capture.set(cv::CAP_PROP_FRAME_HEIGHT, height);
  if (fps > 0) capture.set(cv::CAP_PROP_FPS, fps);
  write_stream_info(capture);
  forward_frames(capture, "the camera stopped giving frames");
}

// The address and options for FFmpeg.
struct FfmpegInput {
  std::string url;
  std::string options;  // "name;value|name;value"
  std::unique_ptr<tarsier::TlsTunnel> tunnel;
};

// FFmpeg does not verify rtsps at all and follows redirects from https to http (see TlsTunnel). So
// we make verified connections ourselves, and FFmpeg connects only to this machine. Formats that
// load parts from elsewhere (HLS, DASH) are then excluded.
FfmpegInput make_ffmpeg_input(const std::string& url, const tarsier::StreamSecurity& security) {
  constexpr std::string_view kFormatWhitelist =
      "format_whitelist;mpjpeg,mjpeg,mpegts,mpeg,mpegvideo,h264,hevc,m4v,flv,live_flv,asf,avi,nut,"
      "ogg,matroska,webm,mov,mp4,m4a,3gp,3g2,mj2|";
  FfmpegInput opening;
  opening.url = url;
  const std::string scheme = tarsier::lower_case(url.substr(0, url.find(':')));
  const bool is_rtsp = scheme == "rtsp" || scheme == "rtsps";
  const bool uses_tunnel = scheme == "rtsps" || (scheme == "https" && !security.insecure);
  if (uses_tunnel) {
    const std::uint16_t default_port = is_rtsp ? 322 : 443;
    const tarsier::HttpUrl parts = tarsier::parse_url(url, scheme, default_port);
    // The host becomes a line of a request and a part of the options.
    if (parts.host.find_first_not_of(
            "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
            ".-_:") != std::string::npos) {
      fail("has a host name with characters that host names do not have");
    }
    opening.tunnel = std::make_unique<tarsier::TlsTunnel>(parts.host, parts.port, security);
    const std::size_t begin = scheme.size() + 3;
    const std::size_t end = std::min(url.find_first_of("/?#", begin), url.size());
    const std::size_t at = url.substr(0, end).rfind('@');
    const std::string credentials =
        at != std::string::npos && at >= begin ? url.substr(begin, at + 1 - begin) : "";
    opening.url = fmt::format("{}://{}127.0.0.1:{}{}", is_rtsp ? "rtsp" : "http", credentials,
                              opening.tunnel->port(), parts.target);
    ::unsetenv("http_proxy");
    if (!is_rtsp) {
      opening.options =
          fmt::format("{}headers;Host: {}\r\n|", kFormatWhitelist, parts.host_header(default_port));
    }
  }
  // No local files, whatever a playlist says; no buffering for smooth playback.
  opening.options += is_rtsp       ? "rtsp_transport;tcp|protocol_whitelist;rtsp,rtp,srtp,udp,tcp|"
                     : uses_tunnel ? "protocol_whitelist;http,tcp|"
                                   : "protocol_whitelist;https,tls,http,httpproxy,tcp,crypto|";
  opening.options += "fflags;nobuffer|flags;low_delay";
  return opening;
}

[[noreturn]] void run_ffmpeg(const tarsier::StreamSecurity& security) {
  const char* url = std::getenv("TARSIER_CAPTURE_URL");
  if (url == nullptr) fail("no address was given");
  static const FfmpegInput opening =
      make_ffmpeg_input(url, security);  // static: outlives the grabbing thread
  ::setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS", opening.options.c_str(), 1);
  static cv::VideoCapture capture;
  const std::vector<int> options = {cv::CAP_PROP_OPEN_TIMEOUT_MSEC, 8000,
                                    cv::CAP_PROP_READ_TIMEOUT_MSEC, 30000};
  if (!capture.open(opening.url, cv::CAP_FFMPEG, options)) {
    const std::string error_message =
        opening.tunnel != nullptr ? opening.tunnel->error_message() : "";
    fail(error_message.empty()
             ? "cannot be opened as a video stream (address, name and password, network?)"
             : error_message);
  }
  write_stream_info(capture);
  forward_frames(capture, "the stream ended");
}

}  // namespace

int main(int argc, char** argv) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  std::vector<std::string> words(argv + std::min(argc, 1), argv + argc);
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  ::setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 1);
  try {
    if (words.size() == 5 && words[0] == "v4l2") {
      run_camera({words.begin() + 1, words.end()});
    }
    if (words.size() == 3 && words[0] == "ffmpeg") {
      run_ffmpeg({.ca_file = words[2], .insecure = words[1] == "insecure"});
    }
  } catch (const std::exception& error) {
    fail(error.what());
  }
  if (words.size() >= 2 && words[0] == "exec") {
    ::execv(argv[2], argv + 2);
    std::fprintf(stderr, "%s: %s\n", argv[2], tarsier::errno_text(errno).c_str());
    return 3;
  }
  std::fprintf(stderr, "tarsier-capture: a helper of tarsier; it is not started by hand\n");
  return 2;
}
