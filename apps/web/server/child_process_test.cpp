// SPDX-License-Identifier: MIT
#include "child_process.h"

#include "tarsier/core/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <csignal>
#include <fcntl.h>
#include <mutex>
#include <unistd.h>

namespace tarsier::web {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::ElementsAre;

struct Lines {
  std::vector<std::string> output;
  std::vector<std::string> messages;
};

ChildOptions shell(const std::string& script, Lines& lines) {
  ChildOptions options;
  options.arguments = {"/bin/sh", "-c", script};
  options.on_output = [&](std::string_view line) { lines.output.emplace_back(line); };
  options.on_message = [&](std::string_view line) { lines.messages.emplace_back(line); };
  return options;
}

ChildEnd run(ChildOptions options) {
  ChildProcess child(std::move(options), [](const ChildEnd&) {});
  return child.wait(seconds(20)).value();
}

TEST(ChildProcess, ReadsBothStreamsByLines) {
  Lines lines;
  const ChildEnd end =
      run(shell("echo one; echo two >&2; printf 'three\\r\\nfour'; exit 7", lines));
  EXPECT_EQ(end.exit, 7);
  EXPECT_EQ(end.signal, 0);
  EXPECT_THAT(lines.output, ElementsAre("one", "three", "four"));
  EXPECT_THAT(lines.messages, ElementsAre("two"));
  EXPECT_EQ(end.text(), "ended with status 7");
}

TEST(ChildProcess, TruncatesLongLines) {
  Lines lines;
  ChildOptions options = shell("printf 'abcdefgh'; printf 'ijkl\\nm\\n'", lines);
  options.max_line = 5;
  (void)run(std::move(options));
  EXPECT_THAT(lines.output, ElementsAre("abcde", "m"));
}

TEST(ChildProcess, UsesNoShell) {
  Lines lines;
  ChildOptions options = shell("", lines);
  options.arguments = {"/bin/echo", "$(id)", "a b", ";"};
  (void)run(std::move(options));
  EXPECT_THAT(lines.output, ElementsAre("$(id) a b ;"));
}

TEST(ChildProcess, PassesOnlyItsPipes) {
  Lines lines;
  const PipeEnds in = make_pipe();
  const PipeEnds out = make_pipe();
  const int open_here = ::open("/dev/null", O_RDONLY);  // without close-on-exec
  ASSERT_GE(::dup2(open_here, 30), 0);
  ChildOptions options =
      shell("cat <&4 >&3; echo /proc/self/fd/*; [ -t 0 ] || readlink /proc/self/fd/0", lines);
  options.pipes = {{3, out.write_end}, {4, in.read_end}};
  ChildProcess child(std::move(options), [](const ChildEnd&) {});
  ::close(in.read_end);
  ::close(out.write_end);
  ASSERT_EQ(::write(in.write_end, "hello", 5), 5);
  ::close(in.write_end);
  std::array<char, 16> text{};
  EXPECT_EQ(::read(out.read_end, text.data(), text.size()), 5);
  EXPECT_EQ(::read(out.read_end, text.data(), text.size()), 0);  // nobody else holds the other end
  ::close(out.read_end);
  EXPECT_EQ(child.wait(seconds(20)).value().exit, 0);
  ::close(30);
  ::close(open_here);
  ASSERT_EQ(lines.output.size(), 2U);
  EXPECT_EQ(lines.output[0].find("/30"), std::string::npos) << lines.output[0];
  EXPECT_EQ(lines.output[1], "/dev/null");
}

TEST(ChildProcess, ReportsAMissingProgram) {
  Lines lines;
  ChildOptions options = shell("", lines);
  options.arguments = {"/nonexistent/program"};
  EXPECT_THROW(ChildProcess(std::move(options), [](const ChildEnd&) {}), InputError);
  options = shell("exit 0", lines);
  options.folder = "/nonexistent";
  EXPECT_THROW(ChildProcess(std::move(options), [](const ChildEnd&) {}), InputError);
}

TEST(ChildProcess, EnvironmentFolderAndLimits) {
  Lines lines;
  ChildOptions options = shell("echo $A; pwd; ulimit -v; nice", lines);
  options.environment = {{"A", "b c"}};
  options.folder = "/";
  options.max_memory_bytes = 1ULL << 30U;
  options.niceness = 3;
  (void)run(std::move(options));
  EXPECT_THAT(lines.output, ElementsAre("b c", "/", "1048576", testing::_));
}

TEST(ChildProcess, IsInterruptedThenKilled) {
  Lines lines;
  {
    ChildProcess child(
        shell("trap 'echo bye; exit 130' INT; echo up; while :; do sleep 0.01; done", lines),
        [](const ChildEnd&) {});
    child.interrupt(seconds(20));
    const ChildEnd end = child.wait(seconds(20)).value();
    EXPECT_TRUE(end.exit == 130) << end.text();
  }
  ChildProcess stubborn(shell("trap '' INT; echo up; while :; do sleep 0.01; done", lines),
                        [](const ChildEnd&) {});
  stubborn.interrupt(milliseconds(50));
  const ChildEnd end = stubborn.wait(seconds(20)).value();
  EXPECT_TRUE(end.signal == SIGKILL || end.signal == SIGINT) << end.text();
}

TEST(ChildProcess, KillsItsOwnChildren) {
  Lines lines;
  const PipeEnds alive = make_pipe();
  ChildOptions options = shell("sleep 1000 & sleep 1000 & exit 0", lines);
  options.pipes = {{5, alive.write_end}};
  (void)run(std::move(options));
  ::close(alive.write_end);
  char byte = 0;
  EXPECT_EQ(::read(alive.read_end, &byte, 1), 0);  // all that held it are gone
  ::close(alive.read_end);
}

TEST(ChildProcess, TheDestructorKills) {
  Lines lines;
  const PipeEnds alive = make_pipe();
  {
    ChildOptions options = shell("trap '' INT TERM; while :; do sleep 1000; done", lines);
    options.pipes = {{5, alive.write_end}};
    ChildProcess child(std::move(options), [](const ChildEnd&) {});
    EXPECT_FALSE(child.wait(milliseconds(0)));
  }
  ::close(alive.write_end);
  char byte = 0;
  EXPECT_EQ(::read(alive.read_end, &byte, 1), 0);
  ::close(alive.read_end);
}

TEST(ChildProcess, CallsOnEndOnce) {
  Lines lines;
  int calls = 0;
  std::size_t seen = 0;
  {
    ChildProcess child(shell("echo a; echo b", lines), [&](const ChildEnd&) {
      ++calls;
      seen = lines.output.size();
    });
    EXPECT_TRUE(child.wait(seconds(20)));
    child.interrupt(seconds(1));  // nothing happens
    child.kill();
  }
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(seen, 2U);
}

TEST(ChildProcess, ReportsTheSignal) {
  Lines lines;
  const ChildEnd end = run(shell("kill -TERM $$", lines));
  EXPECT_EQ(end.signal, SIGTERM);
  EXPECT_EQ(end.exit, 143);
  EXPECT_THAT(end.text(), testing::HasSubstr("signal 15"));
}

}  // namespace
}  // namespace tarsier::web
