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

// The steps of the work, in this order.
enum class AnnotateStage {
  kPick,         // frames of a video
  kPoints,       // points on the first image
  kConnections,  // pairs of points to draw lines between
  kSymmetry,     // pairs of points that are each other's mirror image
  kImages,       // all other images
};
[[nodiscard]] std::string_view name_of(AnnotateStage stage);  // "pick", "points", ..

// One image and its annotation.
struct AnnotatedImage {
  std::string path;  // can be opened from the current folder
  // px; NaN: not placed. A hidden point keeps its last position.
  Eigen::Matrix2Xd points;
  std::vector<char> is_hidden;    // of each point
  bool done = false;              // a person has confirmed; else the points are a proposal
  bool touched = false;           // a person has moved or hidden a point
  std::optional<cv::Rect2d> box;  // copied from the file
  std::string person;

  [[nodiscard]] bool is_shown(int point) const;  // placed and not hidden
  [[nodiscard]] bool has_points() const;         // any placed or hidden
};

// The data model of `landmarks annotate`: a value type. Copies share images until one changes, so
// that a copy before each edit (for undo) is cheap. All images have as many points as the first.
class AnnotateState {
 public:
  [[nodiscard]] int images() const { return static_cast<int>(images_.size()); }
  [[nodiscard]] const AnnotatedImage& image(int index) const;
  [[nodiscard]] int find(const std::string& path) const;  // -1: not found
  [[nodiscard]] int points() const { return points_; }
  [[nodiscard]] int done() const;  // images
  [[nodiscard]] const std::vector<int>& mirror() const { return mirror_; }
  [[nodiscard]] const std::vector<std::array<int, 2>>& connections() const { return connections_; }
  [[nodiscard]] AnnotateStage stage() const { return stage_; }

  // Edits. Indices out of range and values that are not finite throw std::invalid_argument.
  int add_image(const std::string& path);        // returns its index, also if it exists already
  int add_point(int image, Eigen::Vector2d at);  // not placed in the others
  void remove_point(int point);                  // from all images
  void move_point(int image, int point, Eigen::Vector2d at);  // also shows it
  void hide_point(int image, int point, bool hidden);
  // A proposal, or (`touched`) all points as moved by a person.
  void set_points(int image, const Eigen::Matrix2Xd& points, bool touched = false);
  void clear_points(int image);
  void set_done(int image, bool done);   // points without a position become hidden
  void toggle_connection(int a, int b);  // a != b
  // Declares a and b mirror images of each other (a == b: on the axis); a second call removes this.
  void toggle_mirror(int a, int b);
  void set_stage(AnnotateStage stage) { stage_ = stage; }
  void set_mirror(std::vector<int> mirror);
  void set_connections(std::vector<std::array<int, 2>> connections);

  // The mirror index of each point, -1 if not yet set.
  [[nodiscard]] const std::vector<int>& mirror_so_far() const { return mirror_; }

  // The finished images; includes the mirror only if it is complete.
  [[nodiscard]] face::shape::LandmarkSet finished() const;
  // Adds the finished images of a file; paths can be opened from the current folder.
  void load(const face::shape::LandmarkSet& set, const std::string& set_path);

  // A record of the differences from `before`, as complete values: it may be applied twice. `why`
  // is for people.
  [[nodiscard]] nlohmann::json difference(const AnnotateState& before,
                                          const std::string& why) const;
  // All work of the person that the set's file does not hold: images not yet confirmed, positions
  // of hidden points, an incomplete symmetry, the stage.
  [[nodiscard]] nlohmann::json unfinished() const;
  // Throws InputError(path, reason) for an invalid record; then nothing has changed.
  void apply(const nlohmann::json& record, const std::string& path);
  // Applies a whole journal to the set beside it. A run that was killed after it wrote the set and
  // before it restarted the journal leaves records with fewer points than the set, followed by the
  // records that added the other points. Throws InputError(path, reason) if those are missing,
  // because the journal then belongs to another set; nothing has changed then.
  void replay(const std::vector<nlohmann::json>& records, const std::string& path);

 private:
  AnnotatedImage& change(int index);  // makes the image's own copy
  // `cut` receives images that lost points because the record has fewer; null: that is refused.
  void apply(const nlohmann::json& record, const std::string& path, std::set<int>* cut);

  std::vector<std::shared_ptr<const AnnotatedImage>> images_;
  int points_ = 0;
  std::vector<int> mirror_;  // -1: not set
  std::vector<std::array<int, 2>> connections_;
  AnnotateStage stage_ = AnnotateStage::kPoints;
};

// Lines of JSON, each on the disk when append() returns. A truncated line is skipped.
class AnnotateJournal {
 public:
  explicit AnnotateJournal(std::string path) : path_(std::move(path)) {}
  ~AnnotateJournal();
  AnnotateJournal(const AnnotateJournal&) = delete;
  AnnotateJournal& operator=(const AnnotateJournal&) = delete;

  // Reads the records of an earlier run and takes the lock that excludes a second program. Throws
  // InputError if another program has the lock or the file is not a journal.
  [[nodiscard]] std::vector<nlohmann::json> open();
  void append(const nlohmann::json& record);  // throws OutputError
  // Replaces all lines. Without a record the file is deleted.
  void restart(const std::optional<nlohmann::json>& record);
  [[nodiscard]] int lines() const { return lines_; }

 private:
  void close();

  std::string path_;
  int fd_ = -1;
  int lines_ = 0;
};

}  // namespace tarsier
