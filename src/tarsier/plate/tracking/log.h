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
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::plate {

// A person's correction of an entry. The entry keeps its original text.
struct PlateCorrection {
  std::string text;    // symbols of kAlphabet only
  std::string author;  // who made the correction
  Moment time;         // when it was made
};

// An entry of a log, without its image.
struct LoggedPlate {
  std::int64_t id = 0;
  Moment first_time;
  Moment last_time;
  std::string source;
  std::string text;
  double confidence = 0;
  std::string country;
  std::int64_t frames = 0;
  cv::Rect box;            // of the best reading
  std::string candidates;  // JSON lists in the format of event.h
  std::string readings;
  bool has_crop = false;
  // kOpen: the vehicle was in view when the entry was last written, or the program that wrote it
  // has died. kInterrupted: a later program found that the writer had died, so the vehicle may have
  // stayed longer.
  enum class State { kClosed, kOpen, kInterrupted } state = State::kClosed;
  bool synchronized = true;  // false: the clock was not known to be right
  std::optional<PlateCorrection> correction;
};

struct LogFilter {
  std::string text;   // upper case; '*' is any characters, '?' any one; empty matches any text
  bool near = false;  // tolerates one wrong, missing or extra character; O/Q/D count as 0, I as 1
  // Entries in view at some time between `since` and `until`.
  std::optional<Moment> since;
  std::optional<Moment> until;
  std::string source;      // as logged; empty matches any source
  std::int64_t limit = 0;  // only the newest `limit` entries; 0 means all
};

// Statistics of a text's entries before a given moment.
struct PlateHistory {
  std::int64_t visits = 0;  // entries that ended before the moment
  Moment first_time;        // start of the first and end of the last visit, if there is one
  Moment last_time;
};

struct ForgetOptions {
  int batch = 500;  // entries per transaction
  // Called after each transaction with the number of entries deleted so far. Nothing is locked
  // meanwhile, so other writers can proceed if this function waits. It may throw to end the
  // deletion.
  std::function<void(std::int64_t deleted)> after_batch;

  [[nodiscard]] OptionFields fields() { return {{"batch", batch, range(1, 100'000)}}; }
  void check() const { check_fields(*this); }
};

// The SQLite file of observed plates. Each entry is on the disk when the function that wrote it
// returns. Errors are those of media/sqlite.h (DatabaseLockedError among them); after an error the
// log remains usable. Readers also accept versions 1 (slowly) and 2, which become version 3 at the
// next write.
class PlateLog {
 public:
  explicit PlateLog(const std::string& path, DatabaseAccess access = DatabaseAccess::kCreate,
                    int lock_timeout_ms = 5000);

  // Adds a complete entry with its image. Passwords in the source are removed. Returns the entry's
  // id. Throws OutputError.
  std::int64_t append(const PlateEvent& event);

  // --- for recorders: entries that are updated (recorder.h) ---

  // Registers a program that writes open entries. Open entries of programs that have died become
  // interrupted; their times do not change. `process` names the program. `is_alive` returns whether
  // a program of that name is still running.
  std::int64_t begin_run(const std::string& process,
                         const std::function<bool(const std::string& process)>& is_alive);
  void end_run(std::int64_t run);

  // Writes an entry, closed or open according to the event's state. If `id` is 0, or no entry has
  // this id, a new entry is made. Without `crop` the image does not change. Returns the entry's id.
  std::int64_t put(const PlateEvent& event, std::int64_t id, std::int64_t run,
                   std::optional<std::span<const std::uint8_t>> crop);
  void remove(std::int64_t id);

  // The clock was not synchronized when these entries of the run were written.
  // shift_unsynchronized(): it was set by `by` afterwards. trust_clock(): it has proved to be
  // right.
  void shift_unsynchronized(std::int64_t run, std::chrono::milliseconds by);
  void trust_clock(std::int64_t run);

  // Makes several of the calls above atomic.
  [[nodiscard]] Transaction transaction() { return Transaction(database_); }
  void set_lock_timeout(int milliseconds) { database_.set_lock_timeout(milliseconds); }
  [[nodiscard]] const std::string& path() const { return database_.path(); }

  // --- for readers ---

  // Calls take() with each entry, newest first, until it returns false. Returns the number of
  // entries.
  std::int64_t query(const LogFilter& filter, const std::function<bool(const LoggedPlate&)>& take);

  // Corrects the text of an entry. Searches find the entry by both texts. An entry may have several
  // corrections; the last one counts. Throws InputError if there is no such entry, and
  // std::invalid_argument for a text that is not 1..64 symbols of kAlphabet or an author that is
  // not one line of at most 200 bytes.
  void correct(std::int64_t id, const PlateCorrection& correction);
  // Removes the last correction of an entry; false if there is none. Throws the same exceptions as
  // correct().
  bool undo_correction(std::int64_t id);

  [[nodiscard]] std::optional<LoggedPlate> entry(std::int64_t id);

  // JPEG bytes; empty if there is no image.
  [[nodiscard]] std::vector<std::uint8_t> crop(std::int64_t id);

  // The entries with exactly this (corrected) text that ended before `moment`.
  [[nodiscard]] PlateHistory history(const std::string& text, Moment moment);

  // Deletes the entries that were last in view longer than `age` before `now`, with their images,
  // one batch at a time, and returns the space to the disk. Returns the number of entries. Throws
  // InputError if `now` is before 2024, because such a clock is wrong.
  //
  // An entry written with an unsynchronized clock that was never corrected may be younger than its
  // times say. It counts as old if it is `age` older than the newest entry of its run, or if an
  // earlier call saw it `age` ago.
  std::int64_t forget(Moment now, std::chrono::milliseconds age, const ForgetOptions& options = {});

 private:
  struct Match {
    std::int64_t last_time = 0;
    std::int64_t id = 0;
  };
  [[nodiscard]] std::vector<Match> find_matches(const LogFilter& filter);
  [[nodiscard]] std::string columns() const;  // for plate_at(), and the tables
  void add_grams(std::int64_t id, const std::string& text);
  void remove_grams(std::int64_t id, const std::string& text);
  void mark(const PlateEvent& event, std::int64_t id, std::int64_t run);
  [[nodiscard]] std::string text_of(std::int64_t id);  // original text; throws InputError
  // The text of the last correction, if any.
  [[nodiscard]] std::optional<std::string> correction_of(std::int64_t id);

  Database database_;
  bool indexed_ = false;    // version 2 or later
  bool corrected_ = false;  // version 3
};

// {"id","text","confidence","country","source","first_time","last_time","frames","box",
// "candidates","readings","crop","state","correction"}. Times are ISO 8601. "crop" is true or
// false. "state" is "closed", "open" or "interrupted". "correction" is null or
// {"text","author","time"}. With an unsynchronized clock also "clock":"unsynchronized". Throws
// InputError(path) if the file's lists are not JSON.
[[nodiscard]] nlohmann::ordered_json logged_json(const LoggedPlate& plate, const std::string& path);

// {"seen_before","first_time","last_time","dwell"}: the number of earlier visits, their first and
// last time (ISO 8601, null if there were none), and the duration of the present visit, s.
[[nodiscard]] nlohmann::ordered_json history_json(const PlateHistory& history,
                                                  const PlateEvent& event);

// Header and lines of the CSV format: id, first_time, last_time, source, text, confidence, country,
// frames, x, y, w, h, state, corrected, author, corrected_time.
[[nodiscard]] std::string logged_csv_header();
[[nodiscard]] std::string logged_csv_line(const LoggedPlate& plate);

}  // namespace tarsier::plate
