// Point folder: the plan of a sweep, who works at which of its points, and what became of each, on
// a folder that several processes and machines may share.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {

/// A folder that is no sweep, another one, or a broken one; the text names the file and says what
/// to do.
class SweepError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One point: its place in the table is its place in the plan.
struct PlannedPoint {
  std::string key;      // hexadecimal; a function of what is done there
  nlohmann::json what;  // as the kind of the plan reads it
};

struct PointPlan {
  nlohmann::json head;  // "kind" and what all points have in common
  std::vector<PlannedPoint> points;
};

/// 16 hexadecimal digits for what is done at a point.
std::string point_key(const nlohmann::json& what);

/// The right to work at one point. Given back with the scope, unless it is kept: then it stays as a
/// trace of who did it.
class PointClaim {
 public:
  PointClaim(std::filesystem::path file, int attempt) : file_(std::move(file)), attempt_(attempt) {}
  ~PointClaim();
  PointClaim(const PointClaim&) = delete;
  PointClaim& operator=(const PointClaim&) = delete;
  /// A sign of life for other machines; wanted every kBeat.
  void beat() const noexcept;
  void keep() noexcept { file_.clear(); }
  int attempt() const { return attempt_; }  // 1, or more where an earlier owner has died
  static constexpr double kBeat = 15;       // s
  static constexpr double kLease = 60;  // s without a sign of life, after which an owner is dead

 private:
  std::filesystem::path file_;
  int attempt_;
};

class PointFolder {
 public:
  /// Writes the plan into a new or an empty folder. Throws SweepError where another one is.
  static PointFolder create(const std::filesystem::path& folder, const PointPlan& plan);
  /// Reads the plan back. Throws SweepError.
  explicit PointFolder(const std::filesystem::path& folder);

  const std::filesystem::path& folder() const { return folder_; }
  const nlohmann::json& head() const { return plan_.head; }
  const std::vector<PlannedPoint>& points() const { return plan_.points; }

  /// Null while a living process works at the point, or when it is finished.
  std::unique_ptr<PointClaim> claim(std::size_t point) const;
  /// Says what became of the point; false where it was said before, and that stays.
  bool mark(std::size_t point, const nlohmann::json& result) const;
  bool is_marked(std::size_t point) const;
  /// What became of it; nothing where it is not finished. Throws SweepError for a mark that is
  /// broken or another point's.
  std::optional<nlohmann::json> result(std::size_t point) const;
  /// Those without a mark, in order.
  std::vector<std::size_t> unfinished() const;
  /// Where the run of a point makes its own folder.
  std::filesystem::path runs_of(std::size_t point) const;

 private:
  PointFolder(std::filesystem::path folder, PointPlan plan);
  std::filesystem::path claim_file(std::size_t point, int generation) const;
  std::filesystem::path mark_file(std::size_t point) const;

  std::filesystem::path folder_;
  PointPlan plan_;
};

}  // namespace vitreo
