// SPDX-License-Identifier: MIT
#include "live_session.h"

#include "tarsier/media/testing_folder.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "live.h"
#include "live_stream.h"
#include "studio.h"
#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sys/socket.h>
#include <unistd.h>

namespace tarsier::web {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::seconds;
using namespace std::string_literals;

std::string record(char kind, const std::string& payload) {
  const auto size = static_cast<std::uint32_t>(payload.size() + 1);
  std::string text;
  for (int shift = 24; shift >= 0; shift -= 8) text += static_cast<char>(size >> shift);
  return text + kind + payload;
}

TEST(WindowRecords, AreParsedInPiecesOfAnySize) {
  const std::string stream =
      record('H', "{}") + record('J', std::string(1000, 'x')) + record('S', "");
  for (const std::size_t piece : {std::size_t{1}, std::size_t{3}, std::size_t{7}, stream.size()}) {
    WindowRecords records;
    std::string kinds;
    std::size_t bytes = 0;
    for (std::size_t at = 0; at < stream.size(); at += piece) {
      EXPECT_TRUE(records.feed(std::string_view(stream).substr(at, piece)));
      while (const auto found = records.take()) {
        kinds += found->kind;
        bytes += found->payload.size();
      }
    }
    EXPECT_EQ(kinds, "HJS");
    EXPECT_EQ(bytes, 1002U);
  }
}

TEST(WindowRecords, RefuseTooLargeAndEmptyOnes) {
  for (const std::string& head : {"\xff\xff\xff\xffJ"s, "\0\0\0\0J"s, "\x04\0\0\x01J"s}) {
    WindowRecords records;
    records.feed(head);
    EXPECT_FALSE(records.take());
    EXPECT_TRUE(records.is_broken());
    EXPECT_FALSE(records.feed("x"));
  }
}

TEST(Events, AreCheckedAndPassedOn) {
  EXPECT_EQ(event_line(json::parse(R"({"key":115,"shift":true})")),
            "{\"key\":115,\"shift\":true}\n");
  EXPECT_EQ(event_line(json::parse(R"({"action":"sketch","close":true})")),
            "{\"action\":\"sketch\"}\n");
  EXPECT_EQ(event_line(json::parse(R"({"slider":"a","value":1.5})")),
            "{\"slider\":\"a\",\"value\":1.5}\n");
  EXPECT_EQ(event_line(json::parse(R"({"mouse":"move","x":1,"y":2})")),
            "{\"mouse\":\"move\",\"x\":1,\"y\":2}\n");
  EXPECT_EQ(event_line(json::parse(R"({"mouse":"move","x":1,"y":2,"width":640})")),
            "{\"mouse\":\"move\",\"width\":640,\"x\":1,\"y\":2}\n");
  EXPECT_EQ(event_line(json::parse(R"({"mouse":"wheel","x":1,"y":2,"wheel":-1,"control":false})")),
            "{\"control\":false,\"mouse\":\"wheel\",\"wheel\":-1,\"x\":1,\"y\":2}\n");
  for (const char* text : {"1",
                           "[]",
                           "{}",
                           R"({"close":true})",
                           R"({"want":1})",
                           R"({"quality":1})",
                           R"({"key":"a"})",
                           R"({"key":0})",
                           R"({"key":1.5})",
                           R"({"key":131072})",
                           R"({"mouse":"wheel","x":1,"y":1,"wheel":101})",
                           R"({"mouse":"wheel","x":1,"y":1,"wheel":0.5})",
                           R"({"mouse":"move"})",
                           R"({"mouse":"jump","x":1,"y":1})",
                           R"({"mouse":"move","x":1e9,"y":1})",
                           R"({"mouse":"move","x":1,"y":1,"width":0})",
                           R"({"mouse":"move","x":1,"y":1,"width":1.5})",
                           R"({"mouse":"move","x":"1","y":1})",
                           R"({"slider":"a"})",
                           R"({"slider":"","value":1})",
                           R"({"slider":"a","value":"1"})",
                           R"({"slider":"a","value":1e300})",
                           R"({"action":1})",
                           R"({"action":"a\nb"})",
                           R"({"key":1,"shift":1})"})
    EXPECT_EQ(event_line(json::parse(text)), std::nullopt) << text;
  EXPECT_EQ(event_line(json{{"action", std::string(101, 'x')}}), std::nullopt);
}

TEST(LiveRecords, AreWritten) {
  std::string out;
  append_record(out, LiveRecord::kImage, "ab", image_head(258, 3) + "JPEG");
  EXPECT_EQ(out, "\0\0\0\x10\x01\x02"s + "ab" + "\0\0\x01\x02\0\0\0\x03"s + "JPEG");
  out.clear();
  append_record(out, LiveRecord::kPing, "", "");
  EXPECT_EQ(out, "\0\0\0\x02\x05\0"s);
  EXPECT_THROW(append_record(out, LiveRecord::kState, std::string(256, 'x'), ""),
               std::invalid_argument);
}

// A child that speaks the protocol of the pipe window.
LiveSession::Options shell(const std::string& script) {
  LiveSession::Options options;
  options.id = "a1";
  options.verb = "test";
  options.name = "test";
  options.shell_text = "sh";
  options.arguments = {"/bin/sh", "-c", script};
  return options;
}

void wait_for(LiveSession& session, const std::function<bool()>& condition) {
  const auto waker = std::make_shared<Waker>();
  session.add_viewer(waker);
  for (int i = 0; i < 200 && !condition(); ++i) waker->wait(milliseconds(50));
  session.remove_viewer(waker);
  EXPECT_TRUE(condition());
}

constexpr const char* kHello = R"(printf '\000\000\000\016H{"title":"t"}' >&4;)";
constexpr const char* kImage =
    R"(printf '\000\000\000\013J\000\000\000\007\000\000\000\005jp' >&4;)";

TEST(LiveSession, SendsAnImageForEachCredit) {
  LiveSession session(
      shell(std::string(kHello) + "while read line <&3; do echo \"$line\"; " + kImage + " done"));
  wait_for(session, [&] { return session.hello().number == 1; });
  EXPECT_EQ(*session.hello().json, "{\"title\":\"t\"}");
  EXPECT_EQ(session.image().number, 0U);
  session.request_image();
  session.request_image();  // one credit is under way: no second
  wait_for(session, [&] { return session.image().number == 1; });
  EXPECT_EQ(session.image().frame, 7U);
  EXPECT_GE(session.image().age_now(), 5U);
  EXPECT_EQ(*session.image().jpeg, "jp");
  session.request_image();
  // The lines come by another pipe.
  wait_for(session,
           [&] { return session.image().number == 2 && session.describe()["output"].size() == 2; });
  const json seen = session.describe();
  EXPECT_EQ(seen["title"], "t");
  EXPECT_EQ(seen["output"].size(), 2U);
  EXPECT_EQ(seen["running"], true);
}

TEST(StreamSlots, TakeTurnsWithManyStreamsOfABrowser) {
  StreamSlots slots(8);
  const auto program = slots.take("");
  std::vector<std::shared_ptr<StreamSlots::Slot>> own;
  for (std::size_t i = 0; i < StreamSlots::kMaxConcurrent; ++i)
    own.push_back(slots.take("browser"));
  const auto other = slots.take("another");
  EXPECT_FALSE(own[0]->takes_turns());
  own.push_back(slots.take("browser"));
  for (const auto& slot : own) EXPECT_TRUE(slot->takes_turns());
  EXPECT_FALSE(other->takes_turns());
  EXPECT_FALSE(program->takes_turns());
  const auto last = slots.take("");
  EXPECT_THROW((void)slots.take(""), HttpError);
  own.pop_back();
  EXPECT_FALSE(own[0]->takes_turns());
  EXPECT_NO_THROW((void)slots.take(""));
}

TEST(LiveSession, ReportsHandledEvents) {
  // It handles the first two events, passes over what is no state, and ends at the third.
  LiveSession session(
      shell(R"(read a <&3; read b <&3; printf '\000\000\000\015S{"events":2}' >&4; read c <&3;)"
            R"(printf '\000\000\000\017S{"events":"x"}' >&4; exit $c)"));
  const auto two = session.send("{}\n{}\n");
  ASSERT_EQ(two, 2);
  EXPECT_TRUE(session.wait_until_handled(*two, seconds(10)));
  EXPECT_FALSE(session.wait_until_handled(3, milliseconds(0)));
  const auto third = session.send("1\n");
  ASSERT_EQ(third, 3);
  EXPECT_FALSE(session.wait_until_handled(*third, seconds(10))) << "it failed before it had";
  LiveSession quits(shell("read a <&3; exit $a"));
  EXPECT_TRUE(quits.wait_until_handled(quits.send("0\n").value_or(0), seconds(10)));
}

// What the child was asked for, line by line.
std::string requested_settings(LiveSession& session) {
  std::string lines;
  const json seen = session.describe();
  for (const json& line : seen["output"]) lines += line.get<std::string>() + ' ';
  return lines;
}

TEST(LiveSession, ImageWidthIsThatOfTheLargestViewer) {
  LiveSession session(shell("while read line <&3; do echo \"$line\"; done; exec sleep 60"));
  const auto small = std::make_shared<Waker>();
  const auto large = std::make_shared<Waker>();
  const auto whole = std::make_shared<Waker>();
  const auto blind = std::make_shared<Waker>();
  session.add_viewer(small, 320);
  session.add_viewer(blind, LiveSession::kNoImages);  // changes nothing
  session.add_viewer(large, 640);
  session.add_viewer(whole);
  session.remove_viewer(whole);
  session.remove_viewer(large);
  session.remove_viewer(small);  // nobody is left: as it is
  session.add_viewer(small, 320);
  EXPECT_TRUE(session.send("{\"action\":\"last\"}\n"));
  const std::string wanted =
      "{\"max_width\":320} {\"max_width\":640} {\"max_width\":0} {\"max_width\":640} "
      "{\"max_width\":320} {\"action\":\"last\"} ";
  for (int i = 0; i < 200 && requested_settings(session) != wanted; ++i)
    small->wait(milliseconds(20));
  EXPECT_EQ(requested_settings(session), wanted);
}

TEST(LiveSession, QualityIsThatOfTheFastestViewer) {
  LiveSession session(shell("while read line <&3; do echo \"$line\"; done; exec sleep 60"));
  const auto slow = std::make_shared<Waker>();
  const auto quick = std::make_shared<Waker>();
  const auto blind = std::make_shared<Waker>();
  session.add_viewer(slow);
  session.add_viewer(blind, LiveSession::kNoImages);
  session.set_quality(slow, 80);  // as it is
  session.set_quality(slow, 40);
  EXPECT_EQ(session.quality(), 40);
  EXPECT_EQ(session.first_fitting_image(), 1U);
  session.add_viewer(quick);  // the best, until it is known to be slow
  EXPECT_EQ(session.quality(), 80);
  session.set_quality(quick, 55);
  session.set_quality(slow, 30);
  session.remove_viewer(quick);
  session.remove_viewer(slow);  // nobody is left: as it is
  session.set_quality(slow, 80);
  EXPECT_EQ(session.quality(), 30);
  EXPECT_TRUE(session.send("{\"action\":\"last\"}\n"));
  const std::string wanted =
      "{\"quality\":40} {\"quality\":80} {\"quality\":55} {\"quality\":30} {\"action\":\"last\"} ";
  for (int i = 0; i < 200 && requested_settings(session) != wanted; ++i)
    slow->wait(milliseconds(20));
  EXPECT_EQ(requested_settings(session), wanted);
}

TEST(LiveStream, ASlowViewerGetsALowerQuality) {
  // Images of 22 bytes that take a second each, by the clock of the test.
  const auto session = std::make_shared<LiveSession>(
      shell(std::string("while read line <&3; do case $line in *want*) ") + kImage +
            " :;; *) echo \"$line\";; esac; done; exec sleep 60"));
  std::array<int, 2> sockets{-1, -1};
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, sockets.data()), 0);
  StreamSlots slots(1);
  ClockTime time{};
  {
    const auto waker = std::make_shared<Waker>();
    const auto stream = make_live_stream(slots.take(""), waker, {}, {{session, 640}}, nullptr,
                                         [&] { return time; });
    std::vector<char> buffer(1 << 16);
    const auto until = [&](milliseconds spent, const std::function<bool()>& condition) {
      for (int i = 0; i < 600 && !condition(); ++i) {
        if (stream->read(buffer, sockets[0]) > 0)
          time += spent;
        else
          waker->wait(milliseconds(20));
      }
      EXPECT_TRUE(condition());
    };
    until(milliseconds(1000),
          [&] { return session->quality() == JpegQualityControl::kMinQuality; });
    until(milliseconds(1), [&] { return session->quality() == JpegQualityControl::kMaxQuality; });
    const auto lines = [&] { return requested_settings(*session); };
    // The child answers when it gets the processor.
    for (int i = 0; i < 200 && lines().find("{\"quality\":80}") == std::string::npos; ++i)
      waker->wait(milliseconds(20));
    EXPECT_THAT(lines(), testing::HasSubstr("{\"quality\":80}"));
    EXPECT_THAT(lines(), testing::StartsWith("{\"max_width\":640} {\"quality\":30} "));
  }
  ::close(sockets[0]);
  ::close(sockets[1]);
}

TEST(LiveSession, SendsStagesOnRequest) {
  LiveSession session(shell(R"(printf '\000\000\000\020H{"stages":true}' >&4;)"
                            R"(while read line <&3; do case $line in *stages*))"
                            R"( echo "$line"; printf '\000\000\000\003Dxy' >&4;; esac; done)"));
  wait_for(session, [&] { return session.hello().number == 1; });
  EXPECT_EQ(session.describe()["stages"], true);
  EXPECT_EQ(session.stages().number, 0U);
  EXPECT_TRUE(session.request_stages());
  wait_for(session, [&] { return session.stages().number == 1; });
  EXPECT_EQ(*session.stages().record, "xy");
  EXPECT_TRUE(session.request_stages());
  wait_for(session, [&] { return session.stages().number == 2; });
  wait_for(session,
           [&] { return requested_settings(session) == "{\"stages\":1} {\"stages\":1} "; });

  LiveSession without(shell(std::string(kHello) + "exec sleep 60"));
  wait_for(without, [&] { return without.hello().number == 1; });
  EXPECT_FALSE(without.request_stages());
  EXPECT_EQ(without.describe()["stages"], false);
}

TEST(LiveSession, ReportsWhyItEnded) {
  LiveSession session(
      shell("echo 'tarsier: a: warning' >&2; echo 'tarsier: error: no such camera' >&2; exit 3"));
  wait_for(session, [&] { return session.ended().json != nullptr; });
  EXPECT_EQ(json::parse(*session.ended().json), (json{{"exit", 3}, {"error", "no such camera"}}));
  EXPECT_FALSE(session.is_running());
  EXPECT_FALSE(session.send("{}\n"));
  EXPECT_EQ(session.describe()["log"].size(), 2U);

  LiveSession killed(shell("kill -9 $$"));
  wait_for(killed, [&] { return killed.ended().json != nullptr; });
  EXPECT_EQ(json::parse(*killed.ended().json)["exit"], 137);
  EXPECT_THAT(json::parse(*killed.ended().json)["error"].get<std::string>(),
              testing::HasSubstr("signal 9"));
}

TEST(LiveSession, RequestedEndsAreNoErrors) {
  LiveSession session(
      shell("trap 'echo error: stopped >&2; exit 130' INT; while :; do sleep 0.01; done"));
  session.close();
  wait_for(session, [&] { return session.ended().json != nullptr; });
  EXPECT_EQ(json::parse(*session.ended().json)["error"], nullptr);
}

TEST(LiveSession, MasksSecrets) {
  LiveSession::Options options =
      shell(R"(echo 'rtsp://u:p@h/x: 1' ; echo 'tarsier: error: rtsp://u:p@h/x: lost' >&2;)"
            R"(printf '\000\000\000\034S{"status":"rtsp://u:p@h/x"}' >&4; exit 4)");
  options.secrets = {{"rtsp://u:p@h/x", "allowed:door"}};
  LiveSession session(std::move(options));
  wait_for(session, [&] { return session.ended().json != nullptr && session.state().number == 1; });
  const std::string seen =
      session.describe().dump() + *session.ended().json + *session.state().json;
  EXPECT_EQ(seen.find("u:p"), std::string::npos) << seen;
  EXPECT_NE(seen.find("allowed:door"), std::string::npos) << seen;
}

TEST(LiveSession, ReportsForgottenPeopleOnce) {
  const auto state = [](const std::string& names) {
    const std::string text = "{\"state\":{\"a\":1,\"forgotten\":" + names + "}}";
    return fmt::format("printf '\\000\\000\\000\\{:03o}S{}' >&4;", text.size() + 1, text);
  };
  LiveSession::Options options =
      shell(state("[\"Ann\"]") + state("[\"Ann\"]") + state("[\"Ann\",\"Ben\",3]"));
  std::vector<std::string> names;
  options.on_forgotten = [&](const std::string& name) { names.push_back(name); };
  {
    LiveSession session(std::move(options));
    wait_for(session, [&] { return session.state().number == 3; });
    EXPECT_EQ(*session.state().json, R"({"state":{"a":1}})");
  }
  EXPECT_THAT(names, testing::ElementsAre("Ann", "Ben"));
}

TEST(LiveSession, HasAFolderOfItsOwn) {
  const TemporaryFolder parent;
  LiveSession::Options options = shell("pwd; echo x > made.png");
  options.folder = parent.path() + "/a1";
  {
    LiveSession session(options);
    wait_for(session, [&] { return session.ended().json != nullptr; });
    EXPECT_EQ(session.describe()["output"],
              json::array({std::filesystem::canonical(options.folder).string()}));
    EXPECT_TRUE(std::filesystem::exists(options.folder + "/made.png"));
  }
  EXPECT_FALSE(std::filesystem::exists(options.folder));
  options.arguments = {"/nonexistent"};
  EXPECT_ANY_THROW(LiveSession session(options));
  EXPECT_FALSE(std::filesystem::exists(options.folder));
}

TEST(AllowedSources, FilesHaveAbsolutePaths) {
  const auto source = [](const std::string& text) {
    return parse_allowed_sources({"a=" + text}).front().second;
  };
  EXPECT_EQ(source("."), std::filesystem::absolute("."));
  EXPECT_EQ(source("images/*.jpg"), std::filesystem::absolute("images/*.jpg"));
  EXPECT_EQ(source("/x.mp4"), "/x.mp4");
  for (const char* text : {"0", "rtsp://h/a?x=[1]", "synth:clock?live=1", "/dev/video0"})
    EXPECT_EQ(source(text), text);
}

TEST(LiveSession, InvalidRecordsEndIt) {
  LiveSession session(shell(R"(printf '\377\377\377\377xxx' >&4; exec sleep 60)"));
  wait_for(session, [&] { return session.ended().json != nullptr; });
  EXPECT_FALSE(session.is_running());
}

TEST(LiveSession, PassesOnFramesOfAViewersCamera) {
  LiveSession::Options options = shell("[ \"$TARSIER_VIEWER\" = 5 ] && cat <&5 | od -An -c");
  options.has_camera = true;
  LiveSession session(std::move(options));
  session.offer_frame(std::make_shared<const std::string>("abc"));
  session.end_camera();
  wait_for(session, [&] { return session.ended().json != nullptr; });
  const json seen = session.describe();
  ASSERT_EQ(seen["output"].size(), 1U);
  EXPECT_THAT(seen["output"][0].get<std::string>(),
              testing::MatchesRegex(" *.0 +.0 +.0 +003 +a +b +c"));
}

TEST(LiveSession, ReportsAMissingProgram) {
  LiveSession::Options options = shell("");
  options.arguments = {"/nonexistent"};
  EXPECT_ANY_THROW(LiveSession session(std::move(options)));
}

}  // namespace
}  // namespace tarsier::web
