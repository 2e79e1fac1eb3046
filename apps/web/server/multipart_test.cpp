// SPDX-License-Identifier: MIT
#include "multipart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace tarsier::web {
namespace {

struct Part {
  MultipartPart head;
  std::string content;
  bool is_ended = false;
};

struct Result {
  std::vector<Part> parts;
  bool is_good = true;
  bool is_complete = false;
  std::string error;
};

Result read(const std::string& body, std::size_t piece = 1 << 20,
            const std::string& boundary = "xx") {
  Result result;
  MultipartParser parser(
      boundary, {.on_part =
                     [&](const MultipartPart& part) {
                       result.parts.push_back({part, {}, false});
                     },
                 .on_bytes = [&](std::string_view bytes) { result.parts.back().content += bytes; },
                 .on_end = [&] { result.parts.back().is_ended = true; }});
  for (std::size_t at = 0; at < body.size() && result.is_good; at += piece)
    result.is_good = parser.feed(std::string_view(body).substr(at, piece));
  result.is_complete = parser.is_complete();
  result.error = parser.error();
  return result;
}

const std::string kBody =
    "--xx\r\nContent-Disposition: form-data; name=\"a\"\r\n\r\nvalue\r\n"
    "--xx\r\nContent-Disposition: form-data; name=\"f\"; filename=\"p \\\"q\\\".jpg\"\r\n"
    "content-type: Image/JPEG; x=y\r\n\r\n\r\n--x\r\n-xx\r\n--x--\r\r\n"
    "--xx\r\nContent-Disposition: form-data; name=empty\r\n\r\n\r\n--xx--\r\nepilogue";

TEST(Multipart, ReadsPartsInPiecesOfAnySize) {
  for (const std::size_t piece : {1U, 2U, 3U, 5U, 7U, 64U, 1U << 20U}) {
    const Result result = read(kBody, piece);
    ASSERT_TRUE(result.is_good) << result.error;
    EXPECT_TRUE(result.is_complete);
    ASSERT_EQ(result.parts.size(), 3U) << piece;
    EXPECT_EQ(result.parts[0].head.name, "a");
    EXPECT_EQ(result.parts[0].head.file_name, "");
    EXPECT_EQ(result.parts[0].content, "value");
    EXPECT_EQ(result.parts[1].head.file_name, "p \"q\".jpg");
    EXPECT_EQ(result.parts[1].head.content_type, "image/jpeg");
    EXPECT_EQ(result.parts[1].content, "\r\n--x\r\n-xx\r\n--x--\r");
    EXPECT_EQ(result.parts[2].head.name, "empty");
    EXPECT_EQ(result.parts[2].content, "");
    for (const Part& part : result.parts) EXPECT_TRUE(part.is_ended);
  }
}

TEST(Multipart, SkipsAPreamble) {
  const Result result = read("a preamble\r\n" + kBody);
  EXPECT_EQ(result.parts.size(), 3U);
}

TEST(Multipart, ATruncatedBodyIsNotComplete) {
  for (std::size_t size = 0; size + 14 < kBody.size(); ++size)
    EXPECT_FALSE(read(kBody.substr(0, size)).is_complete) << size;
}

TEST(Multipart, RefusesMalformedBodies) {
  EXPECT_FALSE(read("--xxabc\r\n\r\n\r\n").is_good);
  EXPECT_FALSE(read("--xx\r\n\r\ncontent\r\n--xx--").is_good);
  EXPECT_FALSE(read("--xx\r\nContent-Disposition: attachment; name=a\r\n\r\n\r\n--xx--").is_good);
  EXPECT_FALSE(read("--xx\r\nContent-Disposition: form-data\r\n\r\n\r\n--xx--").is_good);
  EXPECT_FALSE(read("--xx\r\nno colon\r\n\r\n\r\n--xx--").is_good);
  EXPECT_FALSE(read("--xx\r\nA: " + std::string(10000, 'x')).is_good);
  const std::string zero("--xx\r\nContent-Disposition: form-data; name=\"a\0b\"\r\n\r\n\r\n--xx--",
                         60);
  EXPECT_FALSE(read(zero).is_good);
  std::string many;
  for (int i = 0; i < 1001; ++i)
    many += "--xx\r\nContent-Disposition: form-data; name=a\r\n\r\n\r\n";
  EXPECT_FALSE(read(many).is_good);
  EXPECT_EQ(read(many).parts.size(), 1000U);
}

TEST(Multipart, BoundaryOfAContentType) {
  EXPECT_EQ(multipart_boundary("multipart/form-data; boundary=abc"), "abc");
  EXPECT_EQ(multipart_boundary("Multipart/Form-Data; charset=x; Boundary=\"a b\""), "a b");
  EXPECT_EQ(multipart_boundary("multipart/form-data; boundary=abc; x=y"), "abc");
  for (const char* type : {"multipart/mixed; boundary=abc", "multipart/form-data",
                           "multipart/form-data; boundary=", "multipart/form-data; boundary=\"a",
                           "multipart/form-data; boundary=a<b", "application/json"})
    EXPECT_EQ(multipart_boundary(type), std::nullopt) << type;
  EXPECT_EQ(multipart_boundary("multipart/form-data; boundary=" + std::string(71, 'a')),
            std::nullopt);
}

}  // namespace
}  // namespace tarsier::web
