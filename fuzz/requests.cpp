// SPDX-License-Identifier: MIT
// How the studio's server parses requests, forms, events, and the records of its children's
// windows.
#include "tarsier/core/errors.h"
#include "tarsier/media/http_service.h"

#include "fuzz.h"
#include "live_protocol.h"
#include "multipart.h"
#include "origin_rules.h"
#include "request_target.h"
#include "router.h"
#include "secrets.h"
#include "sign_in.h"
#include <nlohmann/json.hpp>

namespace tarsier::fuzz {
namespace {

// One line of an input.
std::string_view line_of(std::string_view text) { return text.substr(0, text.find('\n')); }

}  // namespace

TARSIER_FUZZ_TARGET(web_target, kBytes) {
  const std::string_view text = text_of(input);
  const auto target = web::parse_target(text);
  if (!target) throw InputError("target", "malformed");
  expect(target->path.starts_with('/'), "a path that is not absolute");
  expect((target->path + "/").find("/../") == std::string::npos &&
             (target->path + "/").find("/./") == std::string::npos,
         "a path with dots");
  expect(target->path.find("//") == std::string::npos, "a path with an empty segment");
  for (const char c : target->path)
    expect(static_cast<unsigned char>(c) >= 0x20 && c != 0x5c, "a path with a control character");
  if (const auto query = web::parse_query(target->query))
    expect(query->size() <= 256, "a query of too many fields");
}

TARSIER_FUZZ_TARGET(web_head, kBytes) {
  auto parts = parts_of(input, 4);
  for (std::string_view& part : parts) part = line_of(part);
  const auto host = web::parse_host(parts[0]);
  if (host) expect(!host->host.empty(), "a host without a name");
  web::OriginRules rules;
  rules.port = 8765;
  rules.hosts = {"localhost"};
  web::OriginRules::Head head;
  head.method = "GET";
  head.path = "/api/info";
  head.host = parts[0];
  head.origin = parts[1];
  head.fetch_site = parts[2];
  if (!rules.refusal(head)) {
    expect(host && host->host == "localhost" && host->port == 8765, "a foreign host was taken");
    if (!parts[1].empty())
      expect(web::normal_origin(parts[1]) == "http://localhost:8765", "a foreign origin was taken");
  }
  bool unsatisfiable = false;
  for (const std::uint64_t size : {std::uint64_t{0}, std::uint64_t{1}, std::uint64_t{1000}}) {
    const auto range = web::parse_range(parts[3], size, unsatisfiable);
    if (range) expect(range->first <= range->last && range->last < size, "a range beyond the file");
  }
}

TARSIER_FUZZ_TARGET(web_cookie, kBytes) {
  const std::string_view text = line_of(text_of(input));
  const auto cookie = web::cookie_value(text, web::kCookieName);
  if (!cookie) throw InputError("cookie", "absent");
  expect(cookie->find(';') == std::string::npos, "a cookie that holds another");
  expect(text.find(*cookie) != std::string_view::npos, "a cookie that was not sent");
  // A text that looks like a secret is used in file names.
  if (web::looks_like_secret(*cookie))
    expect(cookie->find_first_not_of("0123456789abcdef") == std::string::npos, "a path");
  expect(equals_in_constant_time(*cookie, *cookie), "it is not equal to itself");
}

TARSIER_FUZZ_TARGET(web_events, kJson) {
  web::Request request;
  request.content_type = "application/json";
  request.body = text_of(input);
  nlohmann::json events;
  try {
    events = request.json();
  } catch (const web::HttpError& error) {
    throw InputError("events", error.what());
  }
  if (!events.is_array()) return;
  for (const auto& event : events) {
    const auto line = web::event_line(event);
    if (!line) continue;
    expect(line->find('\n') == line->size() - 1, "an event of several lines");
    const auto read = nlohmann::json::parse(*line, nullptr, false);
    expect(read.is_object() && !read.contains("close") && !read.contains("want"),
           "an event that pages may not send");
    expect(web::event_line(read) == line, "an event that is not what was passed on");
  }
}

TARSIER_FUZZ_TARGET(web_multipart, kBytes) {
  const auto parts = parts_of(input, 2);
  const auto boundary = web::multipart_boundary(line_of(parts[0]));
  if (!boundary) throw InputError("form", "no boundary");
  struct Seen {
    std::string text;
    bool is_good = true;
  };
  const auto read = [&](std::size_t most) {
    Seen seen;
    bool is_open = false;
    web::MultipartParser parser(
        *boundary, {.on_part =
                        [&](const web::MultipartPart& part) {
                          expect(!is_open, "a part within a part");
                          is_open = true;
                          seen.text +=
                              part.name + "|" + part.file_name + "|" + part.content_type + "|";
                        },
                    .on_bytes =
                        [&](std::string_view bytes) {
                          expect(is_open && !bytes.empty(), "bytes of no part");
                          seen.text += bytes;
                        },
                    .on_end =
                        [&] {
                          expect(is_open, "an end of no part");
                          is_open = false;
                          seen.text += "|end|";
                        }});
    Pieces pieces({reinterpret_cast<const std::uint8_t*>(parts[1].data()), parts[1].size()}, most);
    for (Bytes piece = pieces.next(); !piece.empty() && seen.is_good; piece = pieces.next())
      seen.is_good = parser.feed(text_of(piece));
    seen.text += parser.is_complete() ? "complete" : parser.error();
    return seen;
  };
  const Seen small = read(5);
  expect(small.text == read(1 << 20).text, "the pieces of a form change what is read");
  if (!small.is_good) throw InputError("form", "malformed");
}

TARSIER_FUZZ_TARGET(web_window, kBytes) {
  web::WindowRecords records;
  Pieces pieces(input, 4096);
  std::size_t bytes = 0;
  for (Bytes piece = pieces.next(); !piece.empty(); piece = pieces.next()) {
    if (!records.feed(text_of(piece))) break;
    while (const auto record = records.take()) bytes += 5 + record->payload.size();
  }
  expect(bytes <= input.size(), "more records than bytes");
}

}  // namespace tarsier::fuzz
