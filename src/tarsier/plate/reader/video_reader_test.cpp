// SPDX-License-Identifier: MIT
#include "tarsier/plate/reader/video_reader.h"

#include "tarsier/core/errors.h"
#include "tarsier/synth/sources.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::plate {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

Reading reading_at(cv::Rect box, const std::string& text) {
  Reading reading;
  reading.plate = 0.95;
  reading.text = text;
  reading.confidence = 0.9;
  reading.country = "es";
  reading.box = box;
  reading.candidates.push_back({text, 0.9, "es"});
  return reading;
}

Frame frame_of(const std::string& source, int index, bool still = false) {
  Frame frame;
  frame.image = cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(90));
  frame.index = index;
  frame.time = index * 0.1;
  frame.name = source;
  frame.still = still;
  return frame;
}

std::vector<std::string> closed_texts(const std::vector<PlateEvent>& events) {
  std::vector<std::string> texts;
  for (const PlateEvent& event : events)
    if (event.state == PlateState::kClosed) texts.push_back(event.text + "@" + event.source);
  return texts;
}

// A reader that returns given plates.
class VideoReaderTest : public testing::Test {
 protected:
  [[nodiscard]] VideoReader reader() {
    return {[this](const Frame&, DebugSink*) { return ReaderResult{plates_, 2.5}; }, options_};
  }
  std::vector<Reading> plates_{reading_at({100, 100, 90, 20}, "4725BKZ")};
  TrackerOptions options_;
};

TEST_F(VideoReaderTest, TracksVehiclesAndClosesThemAtTheEnd) {
  const VideoReader video = reader();
  VideoReaderState state;
  std::vector<PlateState> states;
  for (int k = 0; k < 6; ++k) {
    const VideoReaderResult result = video.process(frame_of("street.mp4", k), state);
    EXPECT_EQ(result.plates.size(), 1U);
    EXPECT_EQ(result.tracks.size(), 1U);
    EXPECT_EQ(result.ms, 2.5);
    for (const PlateEvent& event : result.events) states.push_back(event.state);
  }
  EXPECT_THAT(states, ElementsAre(PlateState::kOpened));
  EXPECT_THAT(closed_texts(video.finish(state)), ElementsAre("4725BKZ@street.mp4"));
  EXPECT_THAT(video.finish(state), IsEmpty());
}

TEST_F(VideoReaderTest, ClosesVehiclesInSilence) {
  const VideoReader video = reader();
  VideoReaderState state;
  for (int k = 0; k < 6; ++k) static_cast<void>(video.process(frame_of("camera", k), state));
  VideoReaderResult silence = video.process_silence(0.9, state);
  EXPECT_EQ(silence.tracks.size(), 1U);
  EXPECT_THAT(silence.events, IsEmpty());
  silence = video.process_silence(0.5 + options_.lost_after + options_.return_within + 0.1, state);
  EXPECT_THAT(silence.tracks, IsEmpty());
  EXPECT_THAT(closed_texts(silence.events), ElementsAre("4725BKZ@camera"));
}

TEST_F(VideoReaderTest, AnotherSourceOrAStillClosesVehicles) {
  const VideoReader video = reader();
  VideoReaderState state;
  for (int k = 0; k < 6; ++k) static_cast<void>(video.process(frame_of("a.mp4", k), state));
  EXPECT_TRUE(VideoReader::continues(frame_of("a.mp4", 6), state));
  EXPECT_FALSE(VideoReader::continues(frame_of("b.mp4", 6), state));
  EXPECT_THAT(closed_texts(video.process(frame_of("b.mp4", 0), state).events),
              ElementsAre("4725BKZ@a.mp4"));
  for (int k = 1; k < 6; ++k) static_cast<void>(video.process(frame_of("b.mp4", k), state));
  const VideoReaderResult still = video.process(frame_of("c.jpg", 0, true), state);
  EXPECT_THAT(closed_texts(still.events), ElementsAre("4725BKZ@b.mp4"));
  EXPECT_EQ(still.plates.size(), 1U);
  EXPECT_THAT(still.tracks, IsEmpty());
  EXPECT_THAT(video.finish(state), IsEmpty());  // a still image gives no vehicle event
}

TEST_F(VideoReaderTest, EventsCountFromTheFirstFrameOfTheirSource) {
  const VideoReader video = reader();
  VideoReaderState state;
  for (int k = 0; k < 6; ++k) static_cast<void>(video.process(frame_of("a.mp4", k), state));
  for (int k = 8; k < 14; ++k) {  // only every second frame of the video, for example
    Frame frame = frame_of("b.mp4", k);
    frame.start_index = 7;
    frame.start_time = 0.7;
    static_cast<void>(video.process(frame, state));
  }
  const std::vector<PlateEvent> events = video.finish(state);
  ASSERT_EQ(events.size(), 1U);
  EXPECT_NEAR(events[0].first_time, 0.1, 1e-9);
  EXPECT_NEAR(events[0].last_time, 0.6, 1e-9);
  EXPECT_EQ(events[0].readings.front().frame, 1);
  EXPECT_EQ(events[0].readings.back().frame, 6);
}

TEST_F(VideoReaderTest, ImageSequenceIsOneVideo) {
  const VideoReader video = reader();
  VideoReaderState state;
  for (int k = 0; k < 6; ++k)
    EXPECT_THAT(
        closed_texts(
            video.process(frame_of("frames/" + std::to_string(k) + ".png", k), state).events),
        IsEmpty());
  EXPECT_THAT(closed_texts(video.finish(state)), ElementsAre("4725BKZ@frames"));
}

TEST_F(VideoReaderTest, StatesAreIndependent) {
  const VideoReader video = reader();
  const VideoReader copy = video;
  VideoReaderState a;
  VideoReaderState b;
  for (int k = 0; k < 6; ++k) static_cast<void>(video.process(frame_of("a.mp4", k), a));
  EXPECT_THAT(copy.process(frame_of("b.mp4", 0), b).events, IsEmpty());
  EXPECT_THAT(closed_texts(copy.finish(a)), ElementsAre("4725BKZ@a.mp4"));
}

TEST_F(VideoReaderTest, DropsPlatesOutsideTheRegion) {
  options_.region = parse_region("0,0,0.4,1");
  plates_ = {reading_at({10, 100, 90, 20}, "1111BBB"), reading_at({220, 100, 90, 20}, "2222CCC")};
  const VideoReader video = reader();
  VideoReaderState state;
  const VideoReaderResult still = video.process(frame_of("a.jpg", 0, true), state);
  ASSERT_EQ(still.plates.size(), 1U);
  EXPECT_EQ(still.plates[0].text, "1111BBB");
}

TEST_F(VideoReaderTest, JsonHasTheDocumentedFields) {
  const VideoReader video = reader();
  VideoReaderState state;
  const nlohmann::ordered_json still = to_json(video.process(frame_of("a.jpg", 0, true), state));
  EXPECT_FALSE(still.contains("tracks"));
  EXPECT_EQ(still["ms"], 2.5);
  const nlohmann::ordered_json json = to_json(video.process(frame_of("a.mp4", 0), state));
  EXPECT_EQ(json["plates"][0]["text"], "4725BKZ");
  ASSERT_EQ(json["tracks"].size(), 1U);
  EXPECT_EQ(json["tracks"][0]["box"], (nlohmann::ordered_json{100, 100, 90, 20}));
  EXPECT_EQ(json["tracks"][0]["confirmed"], false);
}

TEST_F(VideoReaderTest, RejectsInvalidOptions) {
  EXPECT_THROW(VideoReader(VideoReader::Read{}, {}), std::invalid_argument);
  options_.lost_after = -1;
  EXPECT_THROW(reader(), std::invalid_argument);
  VideoReaderOptions options;
  options.reader.max_candidates = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

TEST(VideoReaderOfModels, ReadsStillsLikeReader) {
  std::unique_ptr<FrameSource> source;
  std::optional<Frame> frame;
  try {
    source = synth::open_synth_source("car?seed=11&frames=1&size=640x360");
    frame = source->next(std::chrono::seconds(10), {});
  } catch (const InputError&) {
    GTEST_SKIP() << "no typefaces to draw plates with";
  }
  ASSERT_TRUE(frame);
  const ModelStore models(TARSIER_SOURCE_MODELS);
  VideoReaderState state;
  VideoReaderResult of_video = VideoReader::load(models).process(*frame, state);
  ReaderResult of_image = Reader::load(models).process(*frame);
  of_video.ms = of_image.ms = 0;
  of_video.tracks.clear();
  ASSERT_FALSE(of_image.plates.empty());
  EXPECT_EQ(to_json(of_video), to_json(of_image));
}

}  // namespace
}  // namespace tarsier::plate
