// SPDX-License-Identifier: MIT
#include "tarsier/media/event_command.h"

#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <csignal>
#include <fcntl.h>
#include <stdexcept>
#include <string>
#include <sys/stat.h>
#include <unistd.h>

namespace tarsier {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// Nothing here sleeps. Commands and test wait for each other at named pipes.
class EventCommandTest : public FolderTest {
 protected:
  [[nodiscard]] std::string pipe(const std::string& name) const {
    EXPECT_EQ(::mkfifo(path(name).c_str(), 0600), 0);
    return path(name);
  }
  // Reads until nobody holds the other end of the pipe.
  static std::string read_all(const std::string& pipe) {
    const int file = ::open(pipe.c_str(), O_RDONLY | O_CLOEXEC);
    std::string text;
    char piece[4096];
    for (ssize_t n = 0; (n = ::read(file, piece, sizeof piece)) > 0;)
      text.append(piece, static_cast<std::size_t>(n));
    ::close(file);
    return text;
  }
  static void open_gate(const std::string& pipe) {
    const int file = ::open(pipe.c_str(), O_WRONLY | O_CLOEXEC);
    ::close(file);
  }
};

TEST_F(EventCommandTest, RunsOncePerEventInOrder) {
  EventCommand command("cat >>'" + path("events") + "'; echo end >>'" + path("events") + "'", {});
  for (int k = 0; k < 5; ++k) command.post("{\"n\":" + std::to_string(k) + "}");
  command.finish();
  EXPECT_EQ(contents(path("events")),
            "{\"n\":0}\nend\n{\"n\":1}\nend\n{\"n\":2}\nend\n{\"n\":3}\nend\n{\"n\":4}\nend\n");
  EXPECT_EQ(command.counts().ended, 5);
  EXPECT_EQ(command.counts().dropped, 0);
}

TEST_F(EventCommandTest, EventsAreNotPartOfTheCommandLine) {
  EventCommand command("cat >>'" + path("events") + "'", {});
  command.post("$(touch '" + path("broken") + "') `id` ; '\"");
  command.finish();
  EXPECT_THAT(contents(path("events")), HasSubstr("$(touch"));
  EXPECT_EQ(files(), 1U);
}

TEST_F(EventCommandTest, AHangingCommandDropsTheOldestEvents) {
  const std::string started = pipe("started");
  const std::string gate = pipe("gate");
  EventCommandOptions options;
  options.timeout_s = options.finish_s = 3600;
  options.max_waiting = 3;
  // The first command waits at the gate.
  EventCommand command("read -r line; echo \"$line\" >>'" + path("events") +
                           "'; [ \"$line\" != 0 ] "
                           "|| { echo >'" +
                           started + "'; cat '" + gate + "'; }",
                       options);
  command.post("0");
  (void)read_all(started);
  for (int k = 1; k <= 10; ++k) command.post(std::to_string(k));  // while the first one waits
  EXPECT_EQ(command.counts().dropped, 7);
  EXPECT_EQ(command.counts().ended, 0);
  open_gate(gate);
  command.finish();
  EXPECT_EQ(contents(path("events")), "0\n8\n9\n10\n");
  EXPECT_EQ(command.counts().ended, 4);
}

TEST_F(EventCommandTest, CommandMayIgnoreItsInput) {
  EventCommand command("exit 0", {});
  const std::string large(1'000'000, 'x');  // more than a pipe can hold
  command.post(large);
  command.post("small");
  command.finish();
  EXPECT_EQ(command.counts().ended, 2);
}

TEST_F(EventCommandTest, LargeEventsArriveCompletely) {
  EventCommand command("cat >'" + path("event") + "'", {});
  const std::string large(1'000'000, 'x');
  command.post(large);
  command.finish();
  EXPECT_EQ(contents(path("event")), large + '\n');
}

TEST_F(EventCommandTest, TimeoutKillsDescendants) {
  const std::string held = pipe("held");
  EventCommandOptions options;
  options.timeout_s = 0.2;
  options.finish_s = 3600;
  // The command ignores SIGTERM and SIGINT. It and its child neither read nor end.
  EventCommand command("trap '' TERM INT; (trap '' TERM; while :; do sleep 1; done) >'" + held +
                           "' & wait; while :; do sleep 1; done",
                       options);
  command.post(std::string(1'000'000, 'x'));
  EXPECT_EQ(read_all(held), "");  // returns when the last of them has ended
  command.finish();
  EXPECT_EQ(command.counts().killed, 1);
}

TEST_F(EventCommandTest, TheTimeToFinishIsBounded) {
  const std::string started = pipe("started");
  EventCommandOptions options;
  options.timeout_s = 3600;
  options.finish_s = 0.1;
  EventCommand command("echo >'" + started + "'; while :; do sleep 1; done", options);
  command.post("a");
  command.post("b");
  (void)read_all(started);
  command.finish();
  EXPECT_EQ(command.counts().killed, 1);
  EXPECT_EQ(command.counts().dropped, 1);
  command.post("c");
  EXPECT_EQ(command.counts().dropped, 2);
}

TEST_F(EventCommandTest, InterruptionEndsFinish) {
  const std::string started = pipe("started");
  EventCommandOptions options;
  options.timeout_s = options.finish_s = 3600;
  options.interrupted_s = 0;
  std::stop_source stop;
  EventCommand command("echo >'" + started + "'; while :; do sleep 1; done", options,
                       stop.get_token());
  command.post("a");
  (void)read_all(started);
  stop.request_stop();
  command.finish();
  EXPECT_EQ(command.counts().killed, 1);
}

TEST_F(EventCommandTest, CommandsInheritNoDescriptors) {
  const int file = ::open(path("secret").c_str(), O_RDWR | O_CREAT, 0600);  // stays open over exec
  EventCommand command("ls -l /proc/self/fd >'" + path("files") + "'", {});
  command.post("");
  command.finish();
  ::close(file);
  EXPECT_THAT(contents(path("files")), Not(HasSubstr("secret")));
  EXPECT_THAT(contents(path("files")), HasSubstr("pipe:"));
}

TEST_F(EventCommandTest, FailuresAreCounted) {
  EventCommand command("exit 3", {});
  command.post("a");
  command.finish();
  EXPECT_EQ(command.counts().failed, 1);
  EXPECT_THROW(EventCommand("", {}), std::invalid_argument);
  EventCommandOptions options;
  options.timeout_s = 0;
  EXPECT_THROW(EventCommand("true", options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier
