// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/collector.h"

#include "tarsier/synth/boards.h"

#include <gtest/gtest.h>

namespace tarsier::planar::calibration {
namespace {

const BoardSpec kSpec = parse_board("chess:9x6", 0.025);
const geometry::Camera kCamera{640, 480, 600, 600, 319.5, 239.5};

BoardView at(double x, double y, double tilt = 0) {
  return synth::exact_view(kCamera, synth::board_pose(kCamera, kSpec, {x, y}, {tilt, 0, 0}, 0.5),
                           kSpec);
}

TEST(ViewCollectorTest, AcceptsNewSharpViews) {
  ViewCollector collector(kSpec, {640, 480}, {});
  EXPECT_EQ(collector.offer(at(0.3, 0.3), 0.3).decision, ViewDecision::kAccepted);
  EXPECT_EQ(collector.offer(at(0.31, 0.3), 0.3).decision, ViewDecision::kTooSimilar);
  EXPECT_EQ(collector.offer({}, 0).decision, ViewDecision::kNoBoard);
  EXPECT_EQ(collector.offer(at(0.7, 0.7), 0.05).decision, ViewDecision::kBlurred);
  EXPECT_EQ(collector.offer(at(0.7, 0.7), 0.3).decision, ViewDecision::kAccepted);
  EXPECT_EQ(collector.offer(at(0.3, 0.3, 30), 0.3).decision,
            ViewDecision::kAccepted);  // a new tilt
  EXPECT_EQ(collector.views().size(), 3U);
  // The same position, but sharper: it replaces the view.
  const ViewCollector::Answer better = collector.offer(at(0.31, 0.31), 0.6);
  EXPECT_EQ(better.decision, ViewDecision::kReplaced);
  EXPECT_EQ(better.index, 0U);
  EXPECT_EQ(collector.views().size(), 3U);
  EXPECT_EQ(collector.coverage().views, 3);
}

TEST(ViewCollectorTest, WaitsForTheBoardToBeStill) {
  CollectorOptions options;
  options.still_px = 2;
  ViewCollector collector(kSpec, {640, 480}, options);
  // Motion is not known yet.
  EXPECT_EQ(collector.offer(at(0.3, 0.3), 0.3).decision, ViewDecision::kMoving);
  EXPECT_EQ(collector.offer(at(0.33, 0.3), 0.3).decision, ViewDecision::kMoving);
  EXPECT_EQ(collector.offer(at(0.331, 0.3), 0.3).decision, ViewDecision::kAccepted);
  EXPECT_EQ(collector.offer({}, 0).decision, ViewDecision::kNoBoard);
  EXPECT_EQ(collector.offer(at(0.6, 0.3), 0.3).decision, ViewDecision::kMoving);
}

TEST(ViewCollectorTest, UndoesLastViewAndHasLimit) {
  CollectorOptions options;
  options.max_views = 3;
  ViewCollector collector(kSpec, {640, 480}, options);
  for (const double x : {0.25, 0.5, 0.75})
    EXPECT_EQ(collector.offer(at(x, 0.5), 0.3).decision, ViewDecision::kAccepted);
  EXPECT_EQ(collector.offer(at(0.5, 0.25), 0.3).decision, ViewDecision::kFull);
  const double share = collector.coverage().share();
  collector.undo();
  EXPECT_EQ(collector.views().size(), 2U);
  EXPECT_LT(collector.coverage().share(), share);
  EXPECT_EQ(collector.offer(at(0.5, 0.25), 0.3).decision, ViewDecision::kAccepted);
  for (int k = 0; k < 5; ++k) collector.undo();
  EXPECT_EQ(collector.coverage().share(), 0);
  EXPECT_EQ(collector.force(at(0.5, 0.5), 0).decision, ViewDecision::kAccepted);
}

}  // namespace
}  // namespace tarsier::planar::calibration
