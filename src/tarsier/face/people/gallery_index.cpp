// SPDX-License-Identifier: MIT
#include "tarsier/face/people/gallery_index.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/linalg/gemm.h"
#include "tarsier/media/atomic_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <limits>
#include <sys/stat.h>
#include <unistd.h>

namespace tarsier::face::people {
namespace {

using recognition::CellIndex;
using recognition::Recognizer;
using recognition::Rows;

constexpr std::int64_t kReadBatch = 4096;  // templates per read

bool exists(const std::string& path) {
  struct ::stat info {};
  return ::lstat(path.c_str(), &info) == 0;
}

std::string unfinished_path(const Gallery& gallery) { return index_path(gallery) + ".new"; }

// Templates of a model from stored coordinates of faces up to `last`.
recognition::TemplateSource templates_of(Gallery& gallery,
                                         const recognition::CoordinateProjection& projection,
                                         std::int64_t space, std::int64_t last) {
  return [&gallery, &projection, space, last](std::int64_t step, const auto& take) {
    std::vector<std::int64_t> ids;
    Rows rows(kReadBatch, projection.coordinates());
    const auto flush = [&] {
      if (ids.empty()) return;
      take(ids, projection(Rows(rows.topRows(static_cast<Eigen::Index>(ids.size())))));
      ids.clear();
    };
    std::int64_t place = 0;
    for (std::int64_t after = 0;;) {
      const std::int64_t before = after;
      gallery.each_template_after(
          space, after, last, kReadBatch, [&](std::int64_t face, std::span<const float> numbers) {
            after = face;
            if (static_cast<Eigen::Index>(numbers.size()) != rows.cols())
              throw InputError(gallery.path(),
                               fmt::format("face {}: its template is damaged", face));
            if (place++ % step != 0) return;
            rows.row(static_cast<Eigen::Index>(ids.size())) =
                Eigen::Map<const Eigen::RowVectorXf>(numbers.data(), rows.cols());
            ids.push_back(face);
            if (static_cast<std::int64_t>(ids.size()) == kReadBatch) flush();
          });
      if (after == before) break;
    }
    flush();
  };
}

// Overwrites a file with zeros, as SQLite does with deleted rows.
void overwrite(int fd) {
  struct ::stat info {};
  if (fd < 0 || ::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) return;
  const std::vector<char> zeros(1 << 20, '\0');
  for (off_t at = 0; at < info.st_size;) {
    const auto size = static_cast<std::size_t>(
        std::min<off_t>(static_cast<off_t>(zeros.size()), info.st_size - at));
    const ssize_t written = ::pwrite(fd, zeros.data(), size, at);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return;
    at += written;
  }
  (void)::fdatasync(fd);
}

}  // namespace

std::string index_path(const Gallery& gallery) { return gallery.path() + ".index"; }

GalleryIndexReport build_gallery_index(Gallery& gallery, const recognition::Background& background,
                                       const recognition::CellIndexOptions& options,
                                       Progress& progress, const std::stop_token& stop) {
  const std::string temporary = unfinished_path(gallery);
  struct Cleanup {
    const std::string& path;
    ~Cleanup() { (void)::unlink(path.c_str()); }
  } const cleanup{temporary};
  constexpr int kAttempts = 20;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const std::int64_t removals = gallery.removals();
    const auto stored = gallery.model();
    const std::int64_t space = -recognition::fingerprint(background);
    if (gallery.face_count_up_to(kMaxSmallGalleryFaces + 1) <= kMaxSmallGalleryFaces || !stored ||
        stored->space != space)
      throw InputError(gallery.path(),
                       fmt::format("only galleries of more than {} faces, of the default or deep "
                                   "templates, can be indexed",
                                   kMaxSmallGalleryFaces));
    const Recognizer subspace = recognition::recognizer_from_text(stored->body, gallery.path());
    const recognition::CoordinateProjection projection(subspace, background);
    const recognition::CellIndexMetadata metadata{gallery.last_face(), space, stored->id};
    GalleryIndexReport report;
    report.path = index_path(gallery);
    report.faces = gallery.template_count(space, metadata.last_id);
    if (report.faces == 0) throw InputError(gallery.path(), "has no templates");
    // A program that forgets a person deletes the unfinished file; the build then restarts.
    const auto changed = [&] { return gallery.removals() != removals; };
    const auto source = templates_of(gallery, projection, space, metadata.last_id);
    struct Changed {};
    const recognition::TemplateSource watched = [&](std::int64_t step, const auto& take) {
      source(step, [&](std::span<const std::int64_t> ids, const Rows& rows) {
        if (changed()) throw Changed();
        take(ids, rows);
      });
    };
    try {
      report.index = recognition::write_cell_index(temporary, projection.numbers(), report.faces,
                                                   watched, metadata, options, progress, stop);
      const bool placed = gallery.put_index(removals, stored->id, report.index.sha256, [&] {
        if (::rename(temporary.c_str(), report.path.c_str()) != 0)
          throw OutputError(report.path, fmt::format("cannot rename: {}", errno_text(errno)));
        sync_folder(report.path);
      });
      if (placed) return report;
    } catch (const Changed&) {
      progress.end();
    } catch (const std::invalid_argument&) {
      if (!changed()) throw;  // otherwise faces were removed between two passes
      progress.end();
    }
    log_info("{}: the gallery changed while it was indexed: the index is built again",
             gallery.path());
  }
  throw OutputError(gallery.path(), "changes too often to be indexed");
}

GalleryIndexState gallery_index_state(Gallery& gallery) {
  GalleryIndexState state;
  const std::string path = index_path(gallery);
  state.exists = exists(path);
  if (!state.exists) return state;
  try {
    const CellIndex index(path);
    state.faces = index.templates();
    const auto stored = gallery.model();
    if (!gallery.is_index(index.sha256())) {
      state.unused_reason = "is of another state of the gallery";
    } else if (!stored || stored->id != index.metadata().model ||
               stored->space != index.metadata().space) {
      state.unused_reason = "is of templates that were made again since";
    } else {
      state.current = true;
      state.newer = gallery.template_count(stored->space, std::numeric_limits<std::int64_t>::max(),
                                           index.metadata().last_id);
    }
  } catch (const InputError& error) {
    state.unused_reason = std::string(error.what()).substr(path.size() + 2);
  }
  return state;
}

std::unique_ptr<GalleryIndex> GalleryIndex::open(Gallery& gallery,
                                                 const recognition::Background& background,
                                                 const StoredModel& stored,
                                                 const Recognizer& subspace,
                                                 std::string& unused_reason) {
  unused_reason.clear();
  const std::string path = index_path(gallery);
  if (!exists(path)) return nullptr;
  const auto unused = [&](std::string_view why) {
    unused_reason = fmt::format(
        "{}: {}: not used, all faces are compared; rebuild it with `people index`", path, why);
    return nullptr;
  };
  try {
    CellIndex cells(path);
    if (!gallery.is_index(cells.sha256())) return unused("is of another state of the gallery");
    if (stored.id != cells.metadata().model || stored.space != cells.metadata().space ||
        cells.dimension() != subspace.template_length())
      return unused("is of templates that were made again since");
    return std::unique_ptr<GalleryIndex>(
        new GalleryIndex(gallery, background, std::move(cells), subspace));
  } catch (const InputError& error) {
    if (error.path() != path) throw;
    return unused(std::string(error.what()).substr(path.size() + 2));
  }
}

GalleryIndex::GalleryIndex(Gallery& gallery, const recognition::Background& background,
                           CellIndex cells, const Recognizer& subspace)
    : gallery_(gallery),
      background_(background),
      cells_(std::move(cells)),
      projection_(subspace, background),
      candidates_(subspace) {
  candidates_.network = background.network;
  (void)update(subspace);
}

bool GalleryIndex::update(const Recognizer& subspace) {
  if (!gallery_.is_index(cells_.sha256())) return false;
  candidates_.network = subspace.network;
  people_ = gallery_.people_with_faces();
  read_newer();
  read_negatives();
  return true;
}

// Reads all of them again, so that removed people do not stay in memory.
void GalleryIndex::read_newer() {
  std::vector<std::int64_t> ids;
  std::vector<float> numbers;
  const auto width = static_cast<std::size_t>(projection_.coordinates());
  for (std::int64_t after = cells_.metadata().last_id;;) {
    const std::int64_t before = after;
    gallery_.each_template_after(cells_.metadata().space, after,
                                 std::numeric_limits<std::int64_t>::max(), kReadBatch,
                                 [&](std::int64_t face, std::span<const float> values) {
                                   after = face;
                                   if (values.size() != width) return;
                                   ids.push_back(face);
                                   numbers.insert(numbers.end(), values.begin(), values.end());
                                 });
    if (after == before) break;
  }
  newer_templates_ = projection_(Eigen::Map<const Rows>(
      numbers.data(), static_cast<Eigen::Index>(ids.size()), projection_.coordinates()));
  newer_ = std::move(ids);
}

void GalleryIndex::read_negatives() {
  std::map<std::int64_t, std::pair<std::int64_t, std::vector<float>>> now;
  for (const Negative& negative : gallery_.negatives()) {
    if (const auto made = negatives_.find(negative.id); made != negatives_.end()) {
      now.emplace(negative.id, std::pair(negative.person, std::move(made->second.second)));
      continue;
    }
    const cv::Mat crop = gallery_.negative_crop(negative.id);
    if (crop.empty()) continue;  // removed meanwhile
    now.emplace(negative.id,
                std::pair(negative.person,
                          recognition::template_of(
                              candidates_, recognizer_input(candidates_.options.algorithm, crop))));
  }
  negatives_ = std::move(now);
}

Recognition GalleryIndex::recognize(std::span<const float> features, double false_accepts) {
  std::vector<recognition::Candidate> candidates =
      cells_.search(features, kIndexProbes, kIndexCandidates);
  if (!newer_.empty()) {
    std::vector<float> products(newer_.size(), 0.0F);
    const auto length = static_cast<std::ptrdiff_t>(features.size());
    linalg::gemm_kernels().dots(1, static_cast<int>(newer_.size()), static_cast<int>(length),
                                features.data(), length, newer_templates_.data(), length,
                                products.data(), static_cast<std::ptrdiff_t>(newer_.size()));
    for (std::size_t i = 0; i < newer_.size(); ++i) candidates.push_back({newer_[i], products[i]});
    const auto better = [](const recognition::Candidate& a, const recognition::Candidate& b) {
      return a.score != b.score ? a.score > b.score : a.id < b.id;
    };
    if (candidates.size() > kIndexCandidates) {
      std::nth_element(candidates.begin(), candidates.begin() + kIndexCandidates, candidates.end(),
                       better);
      candidates.resize(kIndexCandidates);
    }
  }
  std::vector<std::int64_t> ids;
  ids.reserve(candidates.size());
  for (const recognition::Candidate& one : candidates) ids.push_back(one.id);
  std::vector<PersonTemplate> all = gallery_.templates_of_same_people(ids, cells_.metadata().space);
  std::erase_if(all, [&](const PersonTemplate& one) {
    return static_cast<int>(one.numbers.size()) != projection_.coordinates();
  });
  if (all.empty()) return {};
  std::sort(all.begin(), all.end(),
            [](const PersonTemplate& a, const PersonTemplate& b) { return a.face < b.face; });

  // Same order as set_people() of an exact search.
  Rows coordinates(static_cast<Eigen::Index>(all.size()), projection_.coordinates());
  std::vector<std::int64_t> people;
  candidates_.people.clear();
  for (std::size_t i = 0; i < all.size(); ++i) {
    coordinates.row(static_cast<Eigen::Index>(i)) =
        Eigen::Map<const Eigen::RowVectorXf>(all[i].numbers.data(), coordinates.cols());
    auto person = std::find(people.begin(), people.end(), all[i].person);
    if (person == people.end()) person = people.insert(people.end(), all[i].person);
    candidates_.people.push_back(static_cast<int>(person - people.begin()));
  }
  candidates_.labels.assign(people.size(), {});
  candidates_.templates = projection_(coordinates);
  std::vector<const std::vector<float>*> negatives;
  candidates_.negative_people.clear();
  for (const auto& [id, negative] : negatives_) {
    const auto person = std::find(people.begin(), people.end(), negative.first);
    if (person == people.end()) continue;
    negatives.push_back(&negative.second);
    candidates_.negative_people.push_back(static_cast<int>(person - people.begin()));
  }
  candidates_.negatives.resize(static_cast<Eigen::Index>(negatives.size()),
                               candidates_.template_length());
  for (std::size_t i = 0; i < negatives.size(); ++i)
    candidates_.negatives.row(static_cast<Eigen::Index>(i)) = Eigen::Map<const Eigen::RowVectorXf>(
        negatives[i]->data(), static_cast<Eigen::Index>(negatives[i]->size()));
  candidates_.refresh();
  const auto best = recognition::best_person(candidates_, features);
  if (!best) return {};
  Recognition out = recognition_of(candidates_, *best, false_accepts,
                                   static_cast<int>(std::max<std::int64_t>(1, people_)));
  out.label = gallery_.name_of(people[static_cast<std::size_t>(best->person)]);
  out.nearest = -1;
  return out;
}

IndexRemoval::IndexRemoval(Gallery& gallery) : path_(index_path(gallery)) {}

IndexRemoval::~IndexRemoval() {
  if (!prepared_.empty()) (void)::unlink(prepared_.c_str());
  for (const int fd : {old_fd_, unfinished_fd_})
    if (fd >= 0) ::close(fd);
}

void IndexRemoval::prepare(const std::function<std::vector<std::int64_t>()>& kept_faces,
                           bool model_removed, const std::stop_token& stop) {
  // Delete the leftover of an interrupted removal.
  const std::string without = path_ + ".without";
  if (const int left = ::open(without.c_str(), O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
      left >= 0) {
    overwrite(left);
    ::close(left);
  }
  (void)::unlink(without.c_str());
  if (!exists(path_)) return;
  outcome_ = IndexOutcome::kDeleted;
  if (model_removed) return;
  try {
    const CellIndex index(path_);
    old_sha256_ = index.sha256();
    const std::vector<std::int64_t> kept = kept_faces();
    const auto is_kept = [&](std::int64_t id) {
      return std::binary_search(kept.begin(), kept.end(), id);
    };
    const auto& learned = index.learned_from();
    if (!std::all_of(learned.begin(), learned.end(), is_kept)) return;
    bool all = true;
    NoProgress quiet;
    index.each_cell(
        [&](std::span<const std::int64_t> ids) {
          all = all && std::all_of(ids.begin(), ids.end(), is_kept);
        },
        quiet, stop);
    if (all) {
      keep_index_ = true;
      outcome_ = IndexOutcome::kKept;
      return;
    }
    prepared_ = without;
    new_sha256_ = index.write_without(prepared_, is_kept, stop).sha256;
    outcome_ = IndexOutcome::kRewritten;
  } catch (const InputError& error) {
    if (error.path() != path_) throw;   // damaged: delete it
  } catch (const OutputError& error) {  // a full disk must not prevent forgetting
    log_debug("{}", error.what());
    (void)::unlink(without.c_str());
    prepared_.clear();
  }
}

std::string IndexRemoval::replace(const std::string& recorded) {
  // Delete an index that is being built: its builder notices the removal and restarts.
  const std::string unfinished = path_ + ".new";
  unfinished_fd_ = ::open(unfinished.c_str(), O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  (void)::unlink(unfinished.c_str());
  if (!exists(path_)) return {};
  // The file was replaced meanwhile, or never was the gallery's index.
  const bool own = !old_sha256_.empty() && recorded.find(old_sha256_) != std::string::npos;
  std::string now;
  if (own) {
    try {
      now = CellIndex(path_).sha256();
    } catch (const InputError&) {
    }
  }
  if (own && now == old_sha256_ && keep_index_) return old_sha256_;
  old_fd_ = ::open(path_.c_str(), O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (own && now == old_sha256_ && !prepared_.empty()) {
    if (::rename(prepared_.c_str(), path_.c_str()) == 0) {
      prepared_.clear();
      sync_folder(path_);
      return new_sha256_;
    }
  }
  outcome_ = IndexOutcome::kDeleted;
  if (::unlink(path_.c_str()) != 0 && errno != ENOENT)
    throw OutputError(path_, fmt::format("cannot be deleted: {}", errno_text(errno)));
  sync_folder(path_);
  return {};
}

void IndexRemoval::finish() {
  for (int* const fd : {&old_fd_, &unfinished_fd_}) {
    if (*fd < 0) continue;
    overwrite(*fd);
    ::close(std::exchange(*fd, -1));
  }
}

}  // namespace tarsier::face::people
