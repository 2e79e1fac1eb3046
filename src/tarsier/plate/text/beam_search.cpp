// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/beam_search.h"

#include "tarsier/core/require.h"
#include "tarsier/plate/text/ctc.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <utility>

namespace tarsier::plate {
namespace {

// Symbols below these probabilities are not expanded in a column. The limit is lower where a
// character is likely, because the layouts may exclude all symbols of which the classifier was
// sure.
constexpr float kMinProbability = 1e-4F;
constexpr float kMinProbabilityAtCharacter = 1e-6F;
constexpr float kWideSearchFactor = 1e-4F;  // factor of both limits in a wide search
constexpr float kMinSkippedBlank = 0.9999F;

}  // namespace

Decoder::Tables::Tables(CountryChoice country_choice, const DecodeOptions& decode_options)
    : choice(std::move(country_choice)), options(decode_options) {
  options.check();
  TARSIER_REQUIRE(choice.layouts.size() <= kMaxLayouts, "{} layouts", choice.layouts.size());
  TARSIER_REQUIRE(choice.free_text || !choice.layouts.empty(), "neither layouts nor free text");
  words = std::max<std::size_t>(1, (choice.layouts.size() + 63) / 64);
  fitting.assign(words * kSymbols * kMaxPositions, 0);
  std::map<std::string, double> total;  // weight of each country
  for (const Layout& layout : choice.layouts) {
    TARSIER_REQUIRE(layout.weight > 0 && std::isfinite(layout.weight), "weight {}", layout.weight);
    total[layout.country] += layout.weight;
  }
  std::vector<double> priors;
  priors.reserve(choice.layouts.size());
  for (const Layout& layout : choice.layouts) {
    priors.push_back(prior_of(layout, total[layout.country]));
  }
  order.resize(priors.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return priors[a] > priors[b]; });
  for (std::size_t rank = 0; rank < order.size(); ++rank) {
    const Layout& layout = choice.layouts[order[rank]];
    prior.push_back(priors[order[rank]]);
    length.push_back(layout.positions.size());
    add_positions(rank, layout);
  }
}

double Decoder::Tables::prior_of(const Layout& layout, double total) const {
  TARSIER_REQUIRE(!layout.positions.empty() && layout.positions.size() <= kMaxPositions,
                  "a layout of {} places", layout.positions.size());
  TARSIER_REQUIRE(layout.prior > 0 && std::isfinite(layout.prior), "prior {}", layout.prior);
  double sum = options.layout_strength * std::log(layout.prior * layout.weight / total);
  for (const SymbolSet set : layout.positions) {
    TARSIER_REQUIRE(set != 0 && set < (SymbolSet{1} << static_cast<unsigned>(kSymbols)),
                    "a place of layout {} allows {:x}", layout.name, set);
    sum += options.specificity * std::log(static_cast<double>(kSymbols) / std::popcount(set));
  }
  return sum;
}

void Decoder::Tables::add_positions(std::size_t rank, const Layout& layout) {
  for (std::size_t position = 0; position < layout.positions.size(); ++position) {
    for (int symbol = 0; symbol < kSymbols; ++symbol) {
      if ((layout.positions[position] >> static_cast<unsigned>(symbol) & 1U) != 0) {
        fitting[index(position, symbol) + rank / 64] |= std::uint64_t{1} << (rank % 64);
      }
    }
  }
}

namespace {

// A prefix of the beam. As usual in such a search, its probability has two parts: alignments that
// end in a blank, and alignments that end in its last character.
struct Prefix {
  int parent = -1;
  int first_child = -1;
  int next_sibling = -1;
  int symbol = -1;
  std::size_t length = 0;
  bool fits = false;      // some layout is still possible
  bool expanded = false;  // `next` is set
  SymbolSet next = 0;     // symbols after which some layout is still possible
  double best_prior = 1;  // exp(prior) of the most probable layout that is possible
  bool in_beam = false;
  bool touched = false;
  double blank = 0, character = 0;
  double next_blank = 0, next_character = 0;

  [[nodiscard]] double sum() const { return blank + character; }
};

// A kept prefix and a possible next symbol.
struct Extension {
  int parent = 0;
  int symbol = 0;
  double gain = 0;   // probability that moves to the longer text
  double value = 0;  // upper bound of its rank value
};

class Search {
 public:
  Search(const Decoder::Tables& tables, const cv::Mat& probabilities, bool wide)
      : tables_(tables),
        probabilities_(probabilities),
        wide_(wide),
        beam_size_((wide ? 4 : 1) * static_cast<std::size_t>(tables.options.beam)) {
    Prefix root;
    root.blank = 1;
    root.in_beam = true;
    root.fits = !tables_.choice.layouts.empty();
    prefixes_.push_back(root);
    layouts_.assign(tables_.words, 0);
    for (std::size_t k = 0; k < tables_.choice.layouts.size(); ++k) {
      layouts_[k / 64] |= std::uint64_t{1} << (k % 64);
    }
    beam_prefixes_ = {0};
  }

  void run() {
    for (int column = 0; column < probabilities_.rows; ++column) {
      const auto* row = probabilities_.ptr<float>(column);
      if (row[kBlank] > kMinSkippedBlank && !wide_) {
        skip_blank();
      } else {
        advance(row);
      }
    }
  }

  // The complete texts, with their priors.
  [[nodiscard]] std::vector<DecodedText> complete() const {
    std::vector<DecodedText> texts;
    const DecodeOptions& options = tables_.options;
    for (const int k : beam_prefixes_) {
      const Prefix& prefix = prefixes_[static_cast<std::size_t>(k)];
      DecodedText text;
      double prior = kLogZero;
      tables_.for_each(set_of(k), [&](std::size_t rank) {
        if (tables_.length[rank] != prefix.length) return false;
        prior = tables_.prior[rank];
        text.layout = static_cast<int>(tables_.order[rank]);
        text.country = tables_.choice.layouts[tables_.order[rank]].country;
        return true;
      });
      if (tables_.choice.free_text &&
          prefix.length >= static_cast<std::size_t>(options.min_length) &&
          prefix.length <= static_cast<std::size_t>(options.max_length)) {
        prior = std::max(prior, -options.free_penalty);
      }
      if (prior == kLogZero || !(prefix.sum() > 0)) continue;
      text.text = text_of(k);
      text.acoustic = log_scale_ + std::log(prefix.sum());
      text.log_score = text.acoustic + prior;
      texts.push_back(std::move(text));
    }
    return texts;
  }

 private:
  [[nodiscard]] const std::uint64_t* set_of(int prefix) const {
    return &layouts_[static_cast<std::size_t>(prefix) * tables_.words];
  }
  Prefix& at(int index) { return prefixes_[static_cast<std::size_t>(index)]; }

  [[nodiscard]] std::string text_of(int k) const {
    std::string text;
    while (k > 0) {
      const Prefix& prefix = prefixes_[static_cast<std::size_t>(k)];
      text += kAlphabet[static_cast<std::size_t>(prefix.symbol)];
      k = prefix.parent;
    }
    std::reverse(text.begin(), text.end());
    return text;
  }

  // A certain blank: the texts do not change, and all alignments now end in the blank.
  void skip_blank() {
    for (const int k : beam_prefixes_) {
      at(k).blank += at(k).character;
      at(k).character = 0;
    }
  }

  void advance(const float* row) {
    const float min_probability =
        (wide_ ? kWideSearchFactor : 1) *
        (row[kBlank] < 0.5F ? kMinProbabilityAtCharacter : kMinProbability);
    symbols_.clear();
    for (int symbol = 0; symbol < kSymbols; ++symbol) {
      if (row[symbol] >= min_probability) symbols_.push_back(symbol);
    }
    touched_.clear();
    keep_texts(row);
    for (const int k : beam_prefixes_) {
      if (!at(k).expanded) expand(k);
      collect_extensions(k, row);
    }
    for (const bool fits : {true, false}) add_extensions(fits);
    prune();
  }

  // Adds extensions to the beam: those with a layout, or the others.
  void add_extensions(bool fits) {
    std::vector<Extension>& extensions = extensions_[fits ? 1 : 0];
    const std::size_t max_size = beam_size_of(fits);
    // Drops extensions that cannot beat the worst prefix of a full beam, and those beyond the
    // beam's size.
    std::size_t full = 0;
    double min_value = std::numeric_limits<double>::infinity();
    for (const int k : beam_prefixes_) {
      if (at(k).fits != fits) continue;
      ++full;
      min_value = std::min(min_value, (at(k).next_blank + at(k).next_character) * at(k).best_prior);
    }
    if (full >= max_size) {
      std::erase_if(extensions,
                    [&](const Extension& extension) { return extension.value < min_value; });
    }
    if (extensions.size() > 2 * max_size) {
      const auto end = extensions.begin() + static_cast<std::ptrdiff_t>(2 * max_size);
      std::nth_element(extensions.begin(), end, extensions.end(),
                       [](const Extension& a, const Extension& b) {
                         if (a.value != b.value) return a.value > b.value;
                         return a.parent != b.parent ? a.parent < b.parent : a.symbol < b.symbol;
                       });
      extensions.erase(end, extensions.end());
    }
    for (const Extension& extension : extensions) {
      add(child_of(extension.parent, extension.symbol), extension.gain);
    }
    extensions.clear();
  }

  [[nodiscard]] std::size_t beam_size_of(bool fits) const {
    return fits ? beam_size_ : std::max<std::size_t>(4, beam_size_ / 2);
  }

  // The kept texts without a further character.
  void keep_texts(const float* row) {
    for (const int k : beam_prefixes_) {
      Prefix& prefix = at(k);
      touch(k);
      prefix.next_blank = prefix.sum() * static_cast<double>(row[kBlank]);
      if (prefix.symbol >= 0) {
        prefix.next_character = prefix.character * static_cast<double>(row[prefix.symbol]);
      }
    }
  }

  void collect_extensions(int k, const float* row) {
    const Prefix& prefix = at(k);
    const bool may_be_free = tables_.choice.free_text &&
                             prefix.length < static_cast<std::size_t>(tables_.options.max_length);
    for (const int symbol : symbols_) {
      const bool fits = (prefix.next >> static_cast<unsigned>(symbol) & 1U) != 0;
      if (!fits && !may_be_free) continue;
      const double previous =
          prefix.blank + (symbol == prefix.symbol ? 0 : kDirectTransitionWeight * prefix.character);
      const double gain = previous * static_cast<double>(row[symbol]);
      if (!(gain > 0)) continue;
      const int child = find_child(k, symbol);
      if (child >= 0 && at(child).in_beam) {
        add(child, gain);
      } else {
        extensions_[fits ? 1 : 0].push_back(
            {k, symbol, gain, fits ? gain * prefix.best_prior : gain});
      }
    }
  }

  void touch(int k) {
    if (at(k).touched) return;
    at(k).touched = true;
    touched_.push_back(k);
  }

  void add(int k, double gain) {
    touch(k);
    at(k).next_character += gain;
  }

  void expand(int k) {
    Prefix& prefix = at(k);
    prefix.expanded = true;
    if (!prefix.fits || prefix.length >= kMaxPositions) return;
    const std::uint64_t* set = set_of(k);
    for (int symbol = 0; symbol < kSymbols; ++symbol) {
      const std::uint64_t* allowed = &tables_.fitting[tables_.index(prefix.length, symbol)];
      bool any = false;
      for (std::size_t word = 0; word < tables_.words; ++word) {
        any |= (set[word] & allowed[word]) != 0;
      }
      if (any) prefix.next |= SymbolSet{1} << static_cast<unsigned>(symbol);
    }
  }

  [[nodiscard]] int find_child(int k, int symbol) {
    int child = at(k).first_child;
    while (child >= 0 && at(child).symbol != symbol) child = at(child).next_sibling;
    return child;
  }

  // The prefix extended by one symbol.
  int child_of(int k, int symbol) {
    if (const int known = find_child(k, symbol); known >= 0) return known;
    const auto index = static_cast<int>(prefixes_.size());
    Prefix child;
    child.parent = k;
    child.symbol = symbol;
    child.length = at(k).length + 1;
    child.fits = (at(k).next >> static_cast<unsigned>(symbol) & 1U) != 0;
    child.next_sibling = at(k).first_child;
    at(k).first_child = index;
    layouts_.resize(layouts_.size() + tables_.words, 0);
    if (child.fits) {
      const std::uint64_t* allowed = &tables_.fitting[tables_.index(at(k).length, symbol)];
      std::uint64_t* set = &layouts_[static_cast<std::size_t>(index) * tables_.words];
      for (std::size_t word = 0; word < tables_.words; ++word) {
        set[word] = set_of(k)[word] & allowed[word];
      }
      tables_.for_each(set, [&](std::size_t rank) {
        child.best_prior = std::exp(tables_.prior[rank]);
        return true;
      });
    }
    prefixes_.push_back(child);
    return index;
  }

  // Keeps the best prefixes. Those with a layout and the others have separate beams, so that
  // neither displaces the other.
  void prune() {
    double sum = 0;
    for (const int k : touched_) sum += at(k).next_blank + at(k).next_character;
    if (!(sum > 0)) sum = 1;
    for (const int k : touched_) {
      Prefix& prefix = at(k);
      prefix.blank = prefix.next_blank / sum;
      prefix.character = prefix.next_character / sum;
      prefix.next_blank = prefix.next_character = 0;
      prefix.touched = prefix.in_beam = false;
    }
    log_scale_ += std::log(sum);
    const auto boundary =
        std::partition(touched_.begin(), touched_.end(), [this](int k) { return at(k).fits; });
    beam_prefixes_.clear();
    keep_best(touched_.begin(), boundary, beam_size_of(true));
    keep_best(boundary, touched_.end(), beam_size_of(false));
    for (const int k : beam_prefixes_) at(k).in_beam = true;
  }

  void keep_best(std::vector<int>::iterator first, std::vector<int>::iterator last,
                 std::size_t max_size) {
    const auto better = [this](int a, int b) {
      const double value_a = at(a).sum() * at(a).best_prior;
      const double value_b = at(b).sum() * at(b).best_prior;
      return value_a != value_b ? value_a > value_b : a < b;
    };
    const auto count = static_cast<std::ptrdiff_t>(max_size);
    if (last - first > count) {
      std::nth_element(first, first + count, last, better);
      last = first + count;
    }
    beam_prefixes_.insert(beam_prefixes_.end(), first, last);
  }

  const Decoder::Tables& tables_;
  const cv::Mat& probabilities_;
  bool wide_;
  std::size_t beam_size_;
  std::vector<Prefix> prefixes_;
  std::vector<std::uint64_t> layouts_;  // tables_.words per prefix
  std::vector<int> beam_prefixes_;
  std::vector<int> touched_;
  std::vector<int> symbols_;
  std::array<std::vector<Extension>, 2> extensions_;  // of free texts, of layouts
  double log_scale_ = 0;
};

}  // namespace

std::vector<DecodedText> search_texts(const Decoder::Tables& tables, const cv::Mat& probabilities,
                                      bool wide) {
  Search search(tables, probabilities, wide);
  search.run();
  return search.complete();
}

}  // namespace tarsier::plate
