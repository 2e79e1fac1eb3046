// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/gallery.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include "ui/session.h"
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Lists over the image of `people live`, with corrections: the groups of unknown faces, the people,
// the faces of a group or person, and the corrections made so far. One row is selected and others
// may be marked. An action applies to the marked rows, or to the selected row if none is marked.
// Names are typed. All changes go to the gallery at once, so a crash loses nothing, and each
// correction can be undone.
class PeoplePanel {
 public:
  enum class List { kNone, kGroups, kPeople, kFacesOfGroup, kFacesOfPerson, kCorrections };

  struct Options {
    std::function<face::people::CorrectionStamp()> stamp;  // who corrects, and when; empty: unknown
    std::string note;                // note of consent, for the people who get a name
    std::vector<std::string> names;  // suggested first
    std::int64_t max_faces = 20;     // enrolled from a group
  };

  // The gallery must outlive the panel.
  PeoplePanel(face::people::Gallery& gallery, Options options);

  // The actions that it adds to a session.
  [[nodiscard]] static std::vector<Action> actions();

  [[nodiscard]] List list() const { return list_; }
  [[nodiscard]] bool is_open() const { return list_ != List::kNone || typed_.has_value(); }
  [[nodiscard]] bool is_typing() const { return typed_.has_value(); }
  // Performs the action of this name; false if it is not one of the panel, or the panel is closed.
  bool act(std::string_view action);
  // Handles a key while a name is typed, or a key that moves in a list or leaves it; else returns
  // false.
  bool press(const Event& event);
  // A click in the panel selects a row, or marks the selected one. False: it was outside the panel.
  bool click(cv::Point at);
  // Asks for the name of a group without showing its list.
  void name_group(std::int64_t group);
  void close();
  // Reads the list again after a change of the gallery.
  void refresh();

  // Draws the panel over `area` of the image.
  void draw(cv::Mat& image, const cv::Rect& area);
  // Where a row was last drawn, px; empty: not visible.
  [[nodiscard]] cv::Rect row_box(std::size_t row) const;
  // null if the panel is closed, else {"list", "of", "rows": [{"id", "title", "marked"}], "chosen",
  // "typing": text or null, "asking"}, with at most 100 rows.
  [[nodiscard]] nlohmann::json state() const;

  // What was done, or why not, since the last call; empty: nothing.
  [[nodiscard]] std::string take_message();
  // Numbers of the corrections made since the last call.
  [[nodiscard]] std::vector<std::int64_t> take_corrections();
  // Whether people, groups or faces changed since the last call.
  [[nodiscard]] bool take_changed();
  // Names of the people who were forgotten since the last call.
  [[nodiscard]] std::vector<std::string> take_forgotten();

 private:
  struct Row {
    std::int64_t id = 0;
    std::string title;
    std::string detail;
    std::string name;  // of a person, as enrolled
  };
  struct Cell {
    std::size_t row = 0;
    cv::Rect box;
  };

  void reset_selection();
  void open(List list);
  void open_faces();
  void back();
  void move(int by);
  void begin_typing(std::vector<std::string> proposals);
  void end_typing();
  void begin_naming();
  void merge();
  void split();
  void reject_faces();
  void undo();
  void forget();
  // Calls `work` and reports an error as a message.
  void correct(const std::function<void()>& work);
  void record_correction(std::int64_t correction, std::string message);
  [[nodiscard]] const Row* selected_row() const;
  [[nodiscard]] std::vector<const Row*> affected_rows()
      const;  // the marked rows, or the selected one
  [[nodiscard]] std::vector<std::int64_t> affected_ids() const;
  [[nodiscard]] face::people::CorrectionStamp stamp() const;
  [[nodiscard]] std::vector<std::string> proposals() const;
  [[nodiscard]] std::string title() const;
  [[nodiscard]] std::string hint() const;
  [[nodiscard]] bool shows_faces() const;  // a grid of faces, not lines
  const std::vector<std::int64_t>& best_faces(const Row& row);
  const cv::Mat& thumbnail(std::int64_t face);  // of an enrolled face or a sighting; may be empty
  void draw_rows(cv::Mat& image, const cv::Rect& area);
  void draw_faces(cv::Mat& image, const cv::Rect& area);

  face::people::Gallery& gallery_;
  Options options_;
  List list_ = List::kNone;
  List parent_list_ = List::kNone;  // for a list of faces: the list from which it was opened
  std::int64_t group_ = 0;          // whose faces are shown, or which is being named
  std::string person_;              // whose faces are shown
  std::vector<Row> rows_;
  std::size_t selected_ = 0;
  std::size_t first_ = 0;  // first visible row
  std::set<std::int64_t> marked_;
  std::optional<std::string> typed_;
  std::vector<std::string> proposals_;
  std::size_t proposal_ = 0;
  bool is_confirming_ = false;  // asks whether to forget the selected row
  std::string message_;
  std::vector<std::int64_t> corrections_;
  bool changed_ = false;
  std::vector<std::string> forgotten_;
  std::vector<Cell> cells_;
  std::map<std::int64_t, std::vector<std::int64_t>> best_;
  std::map<std::int64_t, cv::Mat> thumbnails_;
};

[[nodiscard]] std::string_view name_of(PeoplePanel::List list);  // "groups", "people" .., "none"

// A face of a gallery as CV_8UC3 with `side` x `side` px.
[[nodiscard]] cv::Mat face_thumbnail(const cv::Mat& crop, int side);

}  // namespace tarsier
