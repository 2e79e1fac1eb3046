// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/media/sqlite.h"
#include "tarsier/plate/tracking/event.h"
#include "tarsier/plate/tracking/plate_pattern.h"
#include "tarsier/plate/tracking/time_text.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::plate {

// What somebody said of an entry later on; its first reading stays beside it.
struct PlateCorrection {
  std::string text;    // symbols of kAlphabet only
  std::string author;  // who said so
  Moment time;         // when
};

// A log's entry, without its image.
struct LoggedPlate {
  std::int64_t id = 0;
  Moment first_time;
  Moment last_time;
  std::string source;
  std::string text;
  double confidence = 0;
  std::string country;
  std::int64_t frames = 0;
  cv::Rect box;            // where it was read best
  std::string candidates;  // JSON lists as event.h writes them
  std::string readings;
  bool has_crop = false;
  // kOpen: in sight when it was last written, or the program that wrote it has died since.
  // kInterrupted: that it has died was seen by the next one; the vehicle may have stayed longer.
  enum class State { kClosed, kOpen, kInterrupted } state = State::kClosed;
  bool synchronized = true;  // false: the clock was not known to be right
  std::optional<PlateCorrection> correction;
};

struct LogFilter {
  std::string text;   // upper case; '*' is any characters, '?' any one; empty: any text
  bool near = false;  // one character may be wrong, missing or too many, and O/Q/D are 0, I is 1
  std::optional<Moment> since;  // entries that were in sight at some time from `since` ..
  std::optional<Moment> until;  // .. to `until`
  std::string source;           // as it was logged; empty: any
  std::int64_t limit = 0;       // the newest so many; 0: all
};

// What a log knows of a text before a moment.
struct PlateHistory {
  std::int64_t visits = 0;  // entries that had ended by then
  Moment first_time;        // begin of the first and end of the last of them; where there is one
  Moment last_time;
};

struct ForgetOptions {
  int batch = 500;  // entries of one transaction
  // Called when so many entries have been deleted in all, after each transaction, while nothing is
  // locked: other writers get their turn if this waits. It may throw to end the deletion.
  std::function<void(std::int64_t deleted)> between;

  [[nodiscard]] OptionFields fields() { return {{"batch", batch, range(1, 100'000)}}; }
  void check() const { check_fields(*this); }
};

// SQLite file of plates that were seen. Each entry is on the disk when the function that wrote it
// returns. Errors as media/sqlite.h says (DatabaseLockedError among them); after one the log can
// still be used. Readers take versions 1 (slowly) and 2 as well: they become version 3 when they
// are next written to.
class PlateLog {
 public:
  explicit PlateLog(const std::string& path, DatabaseAccess access = DatabaseAccess::kCreate,
                    int patience_ms = 5000);

  // A complete entry of its own, with its image. Passwords in a source are not kept. Returns the
  // entry's id. Throws OutputError.
  std::int64_t append(const PlateEvent& event);

  // --- for recorders: entries that grow (recorder.h) ---

  // A program that writes open entries. Those of programs that have died become interrupted; their
  // times stay as they are. `process` names the program, `lives` tells whether one of that name
  // still runs.
  std::int64_t begin_run(const std::string& process,
                         const std::function<bool(const std::string& process)>& lives);
  void end_run(std::int64_t run);

  // Writes an entry, closed or open as the event's state says; `id` 0, or of an entry that is not
  // there any more: a new one. Without `crop` the image stays as it is. Returns its id.
  std::int64_t put(const PlateEvent& event, std::int64_t id, std::int64_t run,
                   std::optional<std::span<const std::uint8_t>> crop);
  void remove(std::int64_t id);

  // The clock was not synchronized when these entries of the run were written: it was set by so
  // much since; or it turned out to be right.
  void shift_unsynchronized(std::int64_t run, std::chrono::milliseconds by);
  void trust_clock(std::int64_t run);

  // Several of the above together or not at all.
  [[nodiscard]] Transaction transaction() { return Transaction(database_); }
  void set_patience(int milliseconds) { database_.set_patience(milliseconds); }
  [[nodiscard]] const std::string& path() const { return database_.path(); }

  // --- for readers ---

  // Calls take() with each entry, newest first, until it returns false. Returns how many.
  std::int64_t query(const LogFilter& filter, const std::function<bool(const LoggedPlate&)>& take);

  // Says what the text of an entry is; searches find it by both texts. Corrections of an entry
  // follow one another: the last one counts. Throws InputError where there is no such entry,
  // std::invalid_argument for a text that is not 1..64 symbols of kAlphabet or an author that is
  // not one line of at most 200 bytes.
  void correct(std::int64_t id, const PlateCorrection& correction);
  // Takes the last correction of an entry back; false: there is none. Throws as correct().
  bool undo_correction(std::int64_t id);

  [[nodiscard]] std::optional<LoggedPlate> entry(std::int64_t id);

  // JPEG bytes, empty where there is no image.
  [[nodiscard]] std::vector<std::uint8_t> crop(std::int64_t id);

  [[nodiscard]] std::int64_t count();

  // The entries of this very text (as corrected, if they are) that ended before `moment`.
  [[nodiscard]] PlateHistory history(const std::string& text, Moment moment);

  // Deletes what was last in sight longer than `age` before `now`, with its images, a batch at a
  // time, and gives the room back to the disk. Returns how many entries that were. An entry that
  // was written while the clock was not synchronized, and never got right times, may be younger
  // than it says: it is old when it is `age` older than the newest of its run, or when an earlier
  // call saw it `age` ago. Throws InputError where `now` is before 2024: such a clock is wrong.
  std::int64_t forget(Moment now, std::chrono::milliseconds age, const ForgetOptions& options = {});

 private:
  struct Found {
    std::int64_t last_time = 0;
    std::int64_t id = 0;
  };
  [[nodiscard]] std::vector<Found> find(const LogFilter& filter);
  [[nodiscard]] std::string columns() const;  // of plate_at(), and where from
  void add_grams(std::int64_t id, const std::string& text);
  void remove_grams(std::int64_t id, const std::string& text);
  void mark(const PlateEvent& event, std::int64_t id, std::int64_t run);
  [[nodiscard]] std::string text_of(std::int64_t id);  // as it was read; throws InputError
  // The text of the last correction, if there is one.
  [[nodiscard]] std::optional<std::string> correction_of(std::int64_t id);

  Database database_;
  bool indexed_ = false;    // version 2
  bool corrected_ = false;  // version 3
};

// {"id","text","confidence","country","source","first_time","last_time","frames","box","candidates",
// "readings","crop","state","correction"}: times as ISO 8601, crop true or false, state "closed",
// "open" or "interrupted", correction null or {"text","author","time"}; and "clock":"unsynchronized" where that is so. Throws InputError(path) where a
// hostile file holds no JSON.
[[nodiscard]] nlohmann::ordered_json logged_json(const LoggedPlate& plate, const std::string& path);

// {"seen_before","first_time","last_time","dwell"}: how often it was there before, from when to when
// (ISO 8601, null where never), and how long it is there now, s.
[[nodiscard]] nlohmann::ordered_json history_json(const PlateHistory& history,
                                                  const PlateEvent& event);

// Header and lines of the CSV form: id, first_time, last_time, source, text, confidence, country,
// frames, x, y, w, h, state, corrected, author, corrected_time.
[[nodiscard]] std::string logged_csv_header();
[[nodiscard]] std::string logged_csv_line(const LoggedPlate& plate);

}  // namespace tarsier::plate
