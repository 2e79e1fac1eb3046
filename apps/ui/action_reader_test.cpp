// SPDX-License-Identifier: MIT
#include "ui/action_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <fcntl.h>
#include <stdexcept>
#include <string>
#include <string_view>
#include <unistd.h>
#include <vector>

namespace tarsier {
namespace {

using ::testing::HasSubstr;

class Pipe {
 public:
  Pipe() {
    if (::pipe(ends_.data()) != 0) throw std::runtime_error("pipe");
  }
  ~Pipe() {
    ::close(ends_[0]);
    close_writer();
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  [[nodiscard]] int reader() const { return ends_[0]; }
  void put(std::string_view text) const {
    ASSERT_EQ(::write(ends_[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }
  void close_writer() {
    if (ends_[1] >= 0) ::close(ends_[1]);
    ends_[1] = -1;
  }

 private:
  std::array<int, 2> ends_{};
};

ActionReader reader_of(const Pipe& pipe) {
  return {pipe.reader(),
          {{"sketch", "lines", 's'}, {"quit", "leave", 'q'}},
          {{"threshold", 0, 255, 1, 80}}};
}

std::vector<std::string> texts(const std::vector<Event>& events) {
  std::vector<std::string> result;
  for (const Event& e : events) {
    result.push_back(e.kind == Event::Kind::kSlider
                         ? e.name + "=" + std::to_string(static_cast<int>(e.value))
                         : e.name);
  }
  return result;
}

using Texts = std::vector<std::string>;

TEST(ActionReader, ReadsActionsAndSlidersInOrder) {
  const Pipe pipe;
  ActionReader reader = reader_of(pipe);
  EXPECT_TRUE(reader.read().empty()) << "does not wait";
  pipe.put("sketch\r\n\n# a comment\n  threshold   60 \nquit\nsk");
  EXPECT_EQ(texts(reader.read()), (Texts{"sketch", "threshold=60", "quit"}));
  EXPECT_TRUE(reader.read().empty());
  pipe.put("etch\n");
  EXPECT_EQ(texts(reader.read()), Texts{"sketch"}) << "a line may come in parts";
  EXPECT_FALSE(reader.ended());
}

TEST(ActionReader, AcceptsALastLineWithoutLineBreak) {
  Pipe pipe;
  ActionReader reader = reader_of(pipe);
  pipe.put("quit");
  EXPECT_TRUE(reader.read().empty());
  pipe.close_writer();
  EXPECT_EQ(texts(reader.read()), Texts{"quit"});
  EXPECT_TRUE(reader.ended());
  EXPECT_TRUE(reader.read().empty());
}

TEST(ActionReader, SkipsInvalidLinesWithAWarning) {
  const Pipe pipe;
  ActionReader reader = reader_of(pipe);
  testing::internal::CaptureStderr();
  pipe.put(
      "dance\x1b[2J\nthreshold\nthreshold x\nthreshold nan\nthreshold 1e\nsketch 4\nthreshold "
      "999\nthreshold -5\n");
  EXPECT_EQ(texts(reader.read()), (Texts{"threshold=255", "threshold=0"}));
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_THAT(
      log, HasSubstr("unknown action 'dance\\x1b[2J'; known are: sketch, quit, threshold NUMBER"));
  EXPECT_THAT(log, HasSubstr("'threshold' needs a number 0..255"));
  EXPECT_THAT(log, HasSubstr("action 'threshold': expected a number, got '1e'"));
  EXPECT_THAT(log, HasSubstr("'sketch' takes no value"));
}

TEST(ActionReader, SkipsOverlongLines) {
  const Pipe pipe;
  ActionReader reader = reader_of(pipe);
  testing::internal::CaptureStderr();
  Texts all;
  for (int i = 0; i < 20; ++i) {
    pipe.put(std::string(4096, 'x'));
    for (const std::string& text : texts(reader.read())) all.push_back(text);
  }
  pipe.put("\nquit\n");
  for (const std::string& text : texts(reader.read())) all.push_back(text);
  EXPECT_EQ(all, Texts{"quit"});
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(log.find("longer than"), log.rfind("longer than")) << "one warning for one line";
}

TEST(ActionReader, EndsAtAClosedDescriptor) {
  const int fd = ::open("/dev/null", O_RDONLY);
  ActionReader null(fd, {}, {});
  (void)null.read();
  EXPECT_TRUE(null.ended());
  ::close(fd);
  ActionReader closed(fd, {}, {});
  (void)closed.read();
  EXPECT_TRUE(closed.ended());
}

}  // namespace
}  // namespace tarsier
