// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/landmark_set.h"

#include <Eigen/Core>

#include <array>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// What there is to do, in this order.
enum class AnnotateStage {
  kPick,         // frames of a video
  kPoints,       // on the first image
  kConnections,  // pairs of points to draw lines between
  kSymmetry,     // pairs of points that are each other's mirror image
  kImages,       // all others
};
[[nodiscard]] std::string_view name_of(AnnotateStage stage);  // "pick", "points", ..

// One image and what was said about it.
struct AnnotatedImage {
  std::string path;               // opens from the current folder
  Eigen::Matrix2Xd points;        // px; NaN: not placed. A hidden point keeps its last place
  std::vector<char> is_hidden;    // of each point
  bool done = false;              // a person has agreed; else the points are a proposal
  bool touched = false;           // a person has moved or hidden something
  std::optional<cv::Rect2d> box;  // carried through from the file
  std::string person;

  [[nodiscard]] bool is_shown(int point) const;  // placed and not hidden
  [[nodiscard]] bool has_points() const;         // any placed or hidden
};

// The editing model of `landmarks annotate`: a value. Images are shared between copies until they
// change, so that a copy before each edit, for undo, costs little. All images have as many points
// as the first.
class AnnotateState {
 public:
  [[nodiscard]] int images() const { return static_cast<int>(images_.size()); }
  [[nodiscard]] const AnnotatedImage& image(int index) const;
  [[nodiscard]] int find(const std::string& path) const;  // -1: not there
  [[nodiscard]] int points() const { return points_; }
  [[nodiscard]] int done() const;  // images
  [[nodiscard]] const std::vector<int>& mirror() const { return mirror_; }
  [[nodiscard]] const std::vector<std::array<int, 2>>& connections() const { return connections_; }
  [[nodiscard]] AnnotateStage stage() const { return stage_; }

  // Edits. Indices out of range and values that are not finite throw std::invalid_argument.
  int add_image(const std::string& path);                     // its index, also where it was there
  int add_point(int image, Eigen::Vector2d at);               // not placed in the others
  void remove_point(int point);                               // from all images
  void move_point(int image, int point, Eigen::Vector2d at);  // shows it, too
  void hide_point(int image, int point, bool hidden);
  // A proposal, or (`touched`) all points moved by a person.
  void set_points(int image, const Eigen::Matrix2Xd& points, bool touched = false);
  void clear_points(int image);
  void set_done(int image, bool done);   // unplaced points count as hidden
  void toggle_connection(int a, int b);  // a != b
  // a and b are each other's mirror image (a == b: on the axis); once more: no longer.
  void toggle_mirror(int a, int b);
  void set_stage(AnnotateStage stage) { stage_ = stage; }
  void set_mirror(std::vector<int> mirror);
  void set_connections(std::vector<std::array<int, 2>> connections);

  // The mirror index of each point, -1 where nothing was said yet.
  [[nodiscard]] const std::vector<int>& mirror_so_far() const { return mirror_; }

  // The finished images; the mirror only when it is complete.
  [[nodiscard]] face::shape::LandmarkSet finished() const;
  // Finished images of the file; paths open from the current folder. Adds to what is there.
  void load(const face::shape::LandmarkSet& set, const std::string& set_path);

  // A record of what differs from `before`, as whole values: applying it twice does no harm.
  // `why` is for people.
  [[nodiscard]] nlohmann::json difference(const AnnotateState& before,
                                          const std::string& why) const;
  // Everything that a person did and the set's file does not hold (images not yet agreed to,
  // places of hidden points, half a symmetry, the stage).
  [[nodiscard]] nlohmann::json unfinished() const;
  // Throws InputError(path, reason) for what no such record can hold; then nothing has changed.
  void apply(const nlohmann::json& record, const std::string& path);
  // A whole journal over the set beside it. A run that was killed when it had written the set and
  // before it began the journal again leaves records of fewer points than the set has, then those
  // that added the rest. Throws InputError(path, reason) where the rest does not come: it is the
  // journal of another set. Then nothing has changed.
  void replay(const std::vector<nlohmann::json>& records, const std::string& path);

 private:
  AnnotatedImage& change(int index);  // a copy of its own
  // `cut`: images that had more points than the record, and lost them; null: that is refused.
  void apply(const nlohmann::json& record, const std::string& path, std::set<int>* cut);

  std::vector<std::shared_ptr<const AnnotatedImage>> images_;
  int points_ = 0;
  std::vector<int> mirror_;  // -1: not said
  std::vector<std::array<int, 2>> connections_;
  AnnotateStage stage_ = AnnotateStage::kPoints;
};

// Lines of JSON, each on the disk before append() returns. A line that was cut short is passed
// over.
class AnnotateJournal {
 public:
  explicit AnnotateJournal(std::string path) : path_(std::move(path)) {}
  ~AnnotateJournal();
  AnnotateJournal(const AnnotateJournal&) = delete;
  AnnotateJournal& operator=(const AnnotateJournal&) = delete;

  // What an earlier run left; takes the lock that keeps a second program out. Throws InputError
  // where another one has it, or for a file that is no journal.
  [[nodiscard]] std::vector<nlohmann::json> open();
  void append(const nlohmann::json& record);  // throws OutputError
  // Replaces all lines. Nothing to say: the file goes.
  void restart(const std::optional<nlohmann::json>& record);
  [[nodiscard]] int lines() const { return lines_; }

 private:
  void close();

  std::string path_;
  int fd_ = -1;
  int lines_ = 0;
};

}  // namespace tarsier
