// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"
#include "tarsier/core/name_table.h"
#include "tarsier/linalg/network.h"
#include "tarsier/media/archive.h"

#include <Eigen/Core>
#include <fmt/format.h>

#include <algorithm>
#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

// Lists the fields of a model file once, for writing and reading:
//
//   void list_spring(linalg::ModelFields& file, Spring& spring) {
//     file.matrix("mean", spring.mean, 2, -1);
//     file.require(spring.mean.cols() >= 2, "'mean' has {} points", spring.mean.cols());
//     file.matrix("modes", spring.modes, spring.mean.size(), -1);
//     file.number("stiffness", spring.stiffness, 0, 10);
//   }
//
//   json to_json(const Spring& spring) { return linalg::written(spring, list_spring); }
//   Spring spring_from_json(const json& value, const std::string& path) {
//     return linalg::read_checked<Spring>(value, path, list_spring);
//   }
//
// Fields are read in the listed order, so a size may depend on an earlier field. The file does not
// depend on the order: the members of its objects are sorted by name.
namespace tarsier::linalg {

class ModelFields {
 public:
  // For writing.
  ModelFields() = default;
  // For reading `object`, which must outlive this. Throws ModelError(path) for fields that do not
  // match.
  ModelFields(const nlohmann::json& object, std::string path)
      : from_(&object), path_(std::move(path)) {}

  [[nodiscard]] bool reads() const { return from_ != nullptr; }
  // Path of the file being read.
  [[nodiscard]] const std::string& path() const { return path_; }
  // The written object.
  [[nodiscard]] nlohmann::json take() { return std::move(to_); }

  // Reading: whether an optional field exists. Writing: whether it must be written.
  [[nodiscard]] bool has(const char* name, bool is_set) const {
    return reads() ? from_->contains(name) : is_set;
  }

  // A number; low..high is checked when reading.
  void number(const char* name, double& value, double low = std::numeric_limits<double>::lowest(),
              double high = std::numeric_limits<double>::max());
  void number(const char* name, float& value, double low, double high);
  template <std::integral Whole>
  void whole(const char* name, Whole& value, std::int64_t low,
             std::int64_t high = std::numeric_limits<Whole>::max()) {
    if (reads()) {
      value = static_cast<Whole>(integer_member(*from_, name, path_, low, high));
    } else {
      to_[name] = value;
    }
  }
  void flag(const char* name, bool& value);
  void text(const char* name, std::string& value, std::size_t max_bytes = 4096);
  // One of the names of name_of(value), or of a table. `parse` throws std::invalid_argument for
  // another name.
  template <class Named, class Parse>
  void named(const char* name, Named& value, const Parse& parse, std::size_t max_bytes = 4096) {
    if (!reads()) {
      to_[name] = name_of(value);
      return;
    }
    try {
      value = parse(text_member(*from_, name, path_, max_bytes));
    } catch (const std::invalid_argument& error) {
      throw ModelError(path_, error.what());
    }
  }
  template <class Named, std::size_t N>
  void named(const char* name, Named& value, const NameTable<Named, N>& table) {
    if (!reads()) {
      to_[name] = table.name(value);
      return;
    }
    const auto found = table.find(text_member(*from_, name, path_));
    require(found.has_value(), "{}: is none of {}", name, fmt::join(table.choices(), ", "));
    value = *found;
  }

  // A matrix in row-major order, as numbers of type `Stored` (void: the matrix's own type). -1: any
  // number of rows or columns. An empty matrix is written with the given sizes. A vector may be
  // stored as one row or as one column.
  template <class Stored = void, class Matrix>
  void matrix(const char* name, Matrix& value, std::int64_t rows, std::int64_t cols) {
    using Own = typename Matrix::Scalar;
    using Number = std::conditional_t<std::is_void_v<Stored>, Own, Stored>;
    if (reads()) {
      take(unpack<Number>(member(*from_, name, path_), path_, name, {rows, cols}), value);
    } else {
      to_[name] = pack(rows_of<Number>(value, rows, cols));
    }
  }
  // The same in half precision (pack_half()). Reading also accepts single precision.
  template <class Matrix>
  void half_matrix(const char* name, Matrix& value, std::int64_t rows, std::int64_t cols) {
    if (reads()) {
      take(unpack<float>(member(*from_, name, path_), path_, name, {rows, cols}), value);
    } else {
      to_[name] = pack_half(rows_of<float>(value, rows, cols));
    }
  }
  // 2 x n, point by point; -1: any number.
  template <class Matrix>
  void points(const char* name, Matrix& value, std::int64_t count) {
    using Number = typename Matrix::Scalar;
    if (reads()) {
      const auto array = unpack<Number>(member(*from_, name, path_), path_, name, {count, 2});
      value = Eigen::Map<const Matrix>(array.values.data(), 2, array.shape[0]);
    } else {
      to_[name] =
          pack(PackedArray<Number>{{value.cols(), 2}, {value.data(), value.data() + value.size()}});
    }
  }
  // A list of `count` numbers (-1: any), stored as type `Stored`.
  template <class Stored, class List>
  void list(const char* name, List& values, std::int64_t count) {
    if (reads()) {
      const auto array = unpack<Stored>(member(*from_, name, path_), path_, name, {count});
      if constexpr (requires { values.resize(array.values.size()); })
        values.resize(static_cast<decltype(values.size())>(array.values.size()));
      std::copy(array.values.begin(), array.values.end(), values.begin());
    } else {
      to_[name] = pack(PackedArray<Stored>{{static_cast<std::int64_t>(values.size())},
                                           {values.begin(), values.end()}});
    }
  }

  // A matrix whose rows are concatenated in `values`. Rows -1: any number.
  template <class Number>
  void rows(const char* name, std::vector<Number>& values, std::int64_t rows, std::int64_t cols) {
    if (reads()) {
      values = unpack<Number>(member(*from_, name, path_), path_, name, {rows, cols}).values;
    } else {
      to_[name] = pack(
          PackedArray<Number>{{static_cast<std::int64_t>(values.size()) / cols, cols}, values});
    }
  }

  // An array of this shape (-1: any), for other containers.
  template <class Number>
  void array(const char* name, PackedArray<Number>& value,
             std::initializer_list<std::int64_t> shape) {
    if (reads()) {
      value = unpack<Number>(member(*from_, name, path_), path_, name, shape);
    } else {
      to_[name] = pack(value);
    }
  }

  // network_to_json(), network_from_json()
  void network(const char* name, Network& value, Precision precision = Precision::kSingle);

  // A nested object; `fields(ModelFields&, value)` lists its fields.
  template <class Part, class Fields>
  void part(const char* name, Part& value, const Fields& fields) {
    if (reads()) {
      ModelFields inner(member(*from_, name, path_), path_);
      fields(inner, value);
    } else {
      ModelFields inner;
      fields(inner, value);
      to_[name] = inner.take();
    }
  }
  // A list of min..max nested objects.
  template <class Part, class Fields>
  void parts(const char* name, std::vector<Part>& values, std::size_t min, std::size_t max,
             const Fields& fields) {
    if (reads()) {
      values.clear();
      for (const nlohmann::json& item : list_of(name, min, max)) {
        ModelFields inner(item, path_);
        fields(inner, values.emplace_back());
      }
    } else {
      nlohmann::json& items = to_[name] = nlohmann::json::array();
      for (Part& value : values) {
        ModelFields inner;
        fields(inner, value);
        items.push_back(inner.take());
      }
    }
  }
  // A value written by `write(value)` (default: to_json()) and read by `read(json, path)`.
  template <class Item, class Write, class Read>
  void item(const char* name, Item& value, const Write& write, const Read& read) {
    if (reads()) {
      value = read(member(*from_, name, path_), path_);
    } else {
      to_[name] = write(std::as_const(value));
    }
  }
  template <class Item, class Read>
  void item(const char* name, Item& value, const Read& read) {
    item(
        name, value, [](const Item& it) { return to_json(it); }, read);
  }
  // The same, omitted if empty.
  template <class Item, class Read>
  void optional(const char* name, std::optional<Item>& value, const Read& read) {
    if (reads()) {
      if (from_->contains(name)) value = read((*from_)[name], path_);
    } else if (value) {
      item(name, *value, read);
    }
  }
  // A value that JSON stores directly; `read(object, path)` reads it from the whole object.
  template <class Value, class Read>
  void other(const char* name, Value& value, const Read& read) {
    if (reads()) {
      value = read(*from_, path_);
    } else {
      to_[name] = value;
    }
  }

  // Returns the list `name` when reading. Throws ModelError unless it has min..max items.
  [[nodiscard]] const nlohmann::json& list_of(const char* name, std::size_t min,
                                              std::size_t max) const;

  // When reading: throws ModelError(path) with this message if the condition is false. When writing
  // it checks nothing, because the model was checked before.
  template <class... Words>
  void require(bool holds, fmt::format_string<Words...> reason, Words&&... words) const {
    if (reads() && !holds)
      throw ModelError(path_, fmt::format(reason, std::forward<Words>(words)...));
  }

 private:
  template <class Number, class Matrix>
  static PackedArray<Number> rows_of(const Matrix& value, std::int64_t rows, std::int64_t cols) {
    using Rows = Eigen::Matrix<Number, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    PackedArray<Number> array;
    array.shape = {value.rows(), value.cols()};
    if (Matrix::IsVectorAtCompileTime && rows == 1) array.shape = {1, value.size()};
    if (value.size() == 0)
      array.shape = {rows < 0 ? value.rows() : rows, cols < 0 ? value.cols() : cols};
    const Rows all = value.template cast<Number>();
    array.values.assign(all.data(), all.data() + all.size());
    return array;
  }
  template <class Number, class Matrix>
  static void take(const PackedArray<Number>& array, Matrix& value) {
    using Rows = Eigen::Matrix<Number, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    if constexpr (Matrix::IsVectorAtCompileTime) {
      using Vector =
          Eigen::Matrix<Number, Matrix::RowsAtCompileTime, Matrix::ColsAtCompileTime,
                        Matrix::RowsAtCompileTime == 1 ? Eigen::RowMajor : Eigen::ColMajor>;
      value = Eigen::Map<const Vector>(array.values.data(),
                                       static_cast<Eigen::Index>(array.values.size()))
                  .template cast<typename Matrix::Scalar>();
    } else {
      value = Eigen::Map<const Rows>(array.values.data(), array.shape[0], array.shape[1])
                  .template cast<typename Matrix::Scalar>();
    }
  }

  const nlohmann::json* from_ = nullptr;
  std::string path_;
  nlohmann::json to_ = nlohmann::json::object();
};

// Writes the fields of `model`, as listed by `fields(ModelFields&, Model&)`.
template <class Model, class Fields>
[[nodiscard]] nlohmann::json written(const Model& model, const Fields& fields) {
  ModelFields file;
  fields(file, const_cast<Model&>(model));  // which only reads it
  return file.take();
}

// The inverse, for untrusted JSON. Throws ModelError(path).
template <class Model, class Fields>
[[nodiscard]] Model read_fields(const nlohmann::json& value, const std::string& path,
                                const Fields& fields) {
  ModelFields file(value, path);
  Model model;
  fields(file, model);
  return model;
}

// The same, followed by the model's check(). A std::invalid_argument becomes a ModelError with
// `prefix` and the reason.
template <class Model, class Fields>
[[nodiscard]] Model read_checked(const nlohmann::json& value, const std::string& path,
                                 const Fields& fields, std::string_view prefix = "") {
  try {
    auto model = read_fields<Model>(value, path, fields);
    model.check();
    return model;
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, std::string(prefix) + error.what());
  }
}

}  // namespace tarsier::linalg
