// SPDX-License-Identifier: MIT
// Images, generic model files, streams, and words that name sources.
#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/capture_protocol.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/http_protocol.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/mjpeg_parser.h"
#include "tarsier/media/still_source.h"
#include "tarsier/media/viewer_source.h"
#include "tarsier/mqtt/address.h"
#include "tarsier/mqtt/hub.h"
#include "tarsier/mqtt/outbox.h"

#include "fuzz.h"
#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::fuzz {

TARSIER_FUZZ_TARGET(mqtt_message, kJson) {
  const std::string text(text_of(input));
  if (const auto event = mqtt::parse_event_message(text)) {
    expect(event->seq >= 1 && event->oldest >= 1 && event->oldest <= event->seq,
           "numbers that no outbox gives");
    const auto again = mqtt::parse_event_message(mqtt::event_message_text(*event));
    expect(!again || (again->seq == event->seq && again->event == event->event),
           "another event when it is sent on");
  }
  if (const auto mark = mqtt::parse_mark(text)) expect(mark->seq >= 0, "a mark before the first");
  (void)mqtt::node_of(text, "tarsier");
}

TARSIER_FUZZ_TARGET(mqtt_address, kBytes) {
  const mqtt::Address address = mqtt::parse_address(text_of(input), "tarsier/here", "--publish");
  const mqtt::Address again = mqtt::parse_address(mqtt::address_text(address), "x", "--publish");
  expect(again.host == address.host && again.port == address.port && again.topic == address.topic,
         "another address when it is shown");
}
namespace {

// Much less than the program's limits, which protect the memory: here an image of 100 MP only costs
// time.
constexpr ImageLimits kImageLimits{.max_pixels = 2'000'000, .max_bytes = 1'000'000};

template <typename T>
void unpack_any(const nlohmann::json& value) {
  const auto attempt = [&](std::initializer_list<std::int64_t> shape) {
    try {
      const PackedArray<T> array = unpack<T>(value, "model", "array", shape);
      std::uint64_t count = 1;
      for (const std::int64_t size : array.shape) count *= static_cast<std::uint64_t>(size);
      expect(count == array.values.size(), "a packed array of another size than its shape");
    } catch (const ModelError&) {
    }
  };
  attempt({-1});
  attempt({-1, -1});
  attempt({-1, 2});
  attempt({2, -1, -1});
}

}  // namespace

TARSIER_FUZZ_TARGET(image, kBytes) {
  const std::optional<ImageHeader> header = probe_image(input);
  const cv::Mat image = decode_image(input, "image", kImageLimits);
  expect(header.has_value(), "an image without a header was decoded");
  expect(image.type() == CV_8UC3 && !image.empty(), "a decoded image of another type");
  const bool same = image.cols == header->width && image.rows == header->height;
  const bool turned = image.cols == header->height && image.rows == header->width;
  expect(same || turned, "the decoded image is of another size than its header says");
}

TARSIER_FUZZ_TARGET(archive, kJson) {
  const Archive archive = read_any_archive(file_of(input, "model.json"));
  for (const nlohmann::json& value : archive.payload) {
    unpack_any<double>(value);
    unpack_any<float>(value);
    unpack_any<std::int32_t>(value);
    unpack_any<std::uint8_t>(value);
  }
  // What was read can be written, and reading it gives the same.
  const std::string path = scratch_folder() + "/written.json";
  write_archive(path, archive);
  expect(read_any_archive(path).payload == archive.payload, "a model changes when it is written");
}

TARSIER_FUZZ_TARGET(mjpeg, kBytes) {
  constexpr std::size_t kLimit = 4096;
  MjpegParser whole(kLimit);
  const int at_once = whole.feed(input);
  MjpegParser parts(kLimit);
  int in_pieces = 0;
  Pieces pieces(input, 64);
  for (Bytes piece = pieces.next(); !piece.empty(); piece = pieces.next()) {
    in_pieces += parts.feed(piece);
    expect(parts.held_bytes() <= 6 * kLimit, "more bytes are held than the limit allows");
  }
  // At most kMaxSegments steps for each start of six bytes, and each byte is copied a few times.
  expect(parts.work() <= 16 * input.size() + 64 && whole.work() <= 16 * input.size() + 64,
         "more steps than the bytes allow");
  expect(at_once == in_pieces, "pieces of other sizes give other images");
  expect(whole.skipped_bytes() == parts.skipped_bytes(), "other bytes are passed over in pieces");
  const std::vector<std::uint8_t> frame = whole.take();
  expect(frame == parts.take(), "pieces of other sizes give another image");
  expect(frame.empty() == (at_once == 0), "an image was counted and is not there");
  if (frame.empty()) return;
  expect(frame.size() >= 4 && frame.size() <= kLimit, "an image beyond the limit");
  expect(frame[0] == 0xff && frame[1] == 0xd8, "an image that does not begin as one");
  expect(frame[frame.size() - 2] == 0xff && frame.back() == 0xd9, "an image without its end");
}

TARSIER_FUZZ_TARGET(viewer, kBytes) {
  ViewerParser whole;
  const std::int64_t at_once = whole.feed(input);
  ViewerParser parts;
  std::int64_t in_pieces = 0;
  Pieces pieces(input, 64);
  for (Bytes piece = pieces.next(); !piece.empty(); piece = pieces.next()) {
    in_pieces += parts.feed(piece);
    expect(parts.held_bytes() <= 4 * input.size() + 64, "more bytes are held than came");
  }
  expect(at_once == in_pieces && whole.is_broken() == parts.is_broken(),
         "pieces of other sizes give other images");
  const std::vector<std::uint8_t> image = whole.take();
  expect(image == parts.take(), "pieces of other sizes give another image");
  expect(image.empty() == (at_once == 0), "an image was counted and is not there");
  if (image.empty()) return;
  const std::string error = viewer_image_error(image);
  const std::optional<ImageHeader> header = probe_image(image);
  if (!error.empty() || std::int64_t{header->width} * header->height > kImageLimits.max_pixels)
    return;
  expect(header->format == ImageFormat::kJpeg, "something else than JPEG is let through");
  (void)decode_image(image, "image", kImageLimits);
}

TARSIER_FUZZ_TARGET(http_response, kBytes) {
  HttpResponseParser whole;
  std::vector<std::uint8_t> body;
  whole.feed(input, body);
  HttpResponseParser parts;
  std::vector<std::uint8_t> body_of_parts;
  Pieces pieces(input, 16);
  for (Bytes piece = pieces.next(); !piece.empty(); piece = pieces.next())
    parts.feed(piece, body_of_parts);
  expect(whole.state() == parts.state(), "pieces of other sizes end in another state");
  expect(whole.status() == parts.status(), "pieces of other sizes give another status");
  expect(whole.content_type() == parts.content_type(), "pieces give another type");
  expect(body == body_of_parts, "pieces of other sizes give another body");
}

TARSIER_FUZZ_TARGET(capture, kBytes) {
  CaptureParser parser;
  std::int64_t frames = 0;
  Pieces pieces(input, 100);
  for (Bytes piece = pieces.next(); !piece.empty(); piece = pieces.next())
    frames += parser.feed(piece);
  expect(frames >= 0, "a negative number of frames");
  if (parser.has_frame()) expect(parser.take().type() == CV_8UC3, "a frame of another type");
}

TARSIER_FUZZ_TARGET(url, kBytes) {
  const std::string text(text_of(input));
  const std::string shown = masked(text);
  try {
    const HttpUrl url = parse_url(text, "http", 80);
    expect(!url.host.empty() && url.port != 0 && url.target.starts_with('/'), "half an address");
    expect(std::none_of(url.target.begin(), url.target.end(),
                        [](char c) { return static_cast<unsigned char>(c) <= 0x20; }),
           "a request that is more than one line");
    expect((url.user.empty() && url.password.empty()) ||
               shown.substr(std::min(shown.size(), shown.find("://"))).starts_with("://***@"),
           "a password is shown");
  } catch (const InputError&) {
  }
  (void)classify_source(text);
}

TARSIER_FUZZ_TARGET(path_list, kBytes) { (void)paths_of_list(file_of(input, "list.txt")); }

}  // namespace tarsier::fuzz
