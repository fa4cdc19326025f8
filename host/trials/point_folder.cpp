// SPDX-License-Identifier: Apache-2.0
#include "host/trials/point_folder.h"

#include "host/files/digest.h"
#include "host/files/posix_file.h"
#include "host/files/published_file.h"
#include "host/files/run_folder.h"
#include "host/record/record_json.h"
#include "host/trials/point_owner.h"

#include <fmt/format.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unordered_set>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

constexpr int kPlanVersion = 1;
constexpr std::size_t kShard = 1000;   // marks and claims in one folder
constexpr std::size_t kFlat = 10'000;  // runs in one folder, which `vitreo runs` can list

std::string shard_of(std::size_t point) { return fmt::format("{:04}", point / kShard); }
std::string name_of(std::size_t point) { return fmt::format("{:06}", point); }

/// One line a point: a plan of a million is read without a million objects at once.
std::string lines_of(const std::vector<PlannedPoint>& points) {
  std::string text;
  for (const PlannedPoint& point : points)
    text += dumped({{"key", point.key}, {"what", point.what}}) + "\n";
  return text;
}

// Named after its content: what another program that makes a plan here at the same time writes has
// another name.
std::string lines_name(const std::string& digest) {
  return "plan." + digest.substr(0, 12) + ".jsonl";
}

/// Discarded where it is no JSON: the callers say which file is damaged, and what to do.
nlohmann::json parsed_file(const fs::path& file) {
  return nlohmann::json::parse(read_whole_file(file), nullptr, false);
}

/// The list of a plan. The head has its digest: a copy that was cut short, or another list, is told
/// from the whole one before a point is begun.
std::vector<PlannedPoint> points_in(const fs::path& file, const nlohmann::json& head) {
  const std::string again = ": copy the whole folder again from where it came";
  if (!fs::is_regular_file(file))
    throw SweepError(file.string() + ": the list of points is missing" + again);
  const std::string text = read_whole_file(file);
  if (sha256(text) != head.value("points_sha256", ""))
    throw SweepError(file.string() + ": is not what plan.json says" + again);
  std::vector<PlannedPoint> points;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = text.find('\n', at);
    nlohmann::json line = nlohmann::json::parse(text.substr(at, end - at));
    points.push_back({line.at("key").get<std::string>(), std::move(line.at("what"))});
    at = end + 1;
  }
  return points;
}

/// Where nothing but leftovers of a plan that was never finished may be.
void refuse_foreign(const fs::path& folder) {
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("plan.") || name.starts_with(".plan")) continue;
    throw SweepError(folder.string() + ": is not empty and no sweep (" + name +
                     " is in it): --out wants a new folder");
  }
}

/// The same points, by their digest, are the same sweep: the way to go on with it is told.
[[noreturn]] void refuse_second(const fs::path& folder, const std::string& digest) {
  const bool same = parsed_file(folder / "plan.json").value("points_sha256", "") == digest;
  throw SweepError(
      same ? folder.string() +
                 ": this sweep is there already; it goes on by: vitreo sweep --resume " +
                 folder.string()
           : folder.string() + ": holds another sweep: --out wants a new folder");
}

/// Of a file, by the clock of the machine that keeps it, which all who share it see alike; s.
double age_of(const fs::path& file) {
  const fs::path probe = file.parent_path() / (".now." + random_hex(12));
  struct stat now {};
  struct stat then {};
  {
    const Descriptor made(create_new_file(probe));
    ::fstat(made.number(), &now);
  }
  std::error_code ignored;
  fs::remove(probe, ignored);
  if (::stat(file.c_str(), &then) != 0) return 0;
  const auto seconds = [](const timespec& time) {
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  };
  return seconds(now.st_mtim) - seconds(then.st_mtim);
}

/// Released, its process gone from this machine, or silent for longer than the lease. A process of
/// this machine that is only slow is never taken for dead.
bool is_dead(const fs::path& claim) {
  const nlohmann::json owner = parsed_file(claim);
  if (owner.is_object() && owner.value("released", false)) return true;
  const OwnerLife life = life_of(owner);
  return life == OwnerLife::dead ||
         (life == OwnerLife::elsewhere && age_of(claim) > PointClaim::kLease);
}

}  // namespace

// Sixteen digits, 64 bits: among a million points two are the same by chance once in 3.7e7 plans
// (n^2 / 2^65), and create() would refuse them.
std::string point_key(const nlohmann::json& what) { return sha256(dumped(what)).substr(0, 16); }

// Overwritten, not removed: a claim that is gone could be made again while another process reads
// its successor. The next owner makes the next generation.
PointClaim::~PointClaim() {
  if (file_.empty()) return;
  try {
    publish(file_, "{\"released\": true}\n");
  } catch (const std::exception&) {  // its owner ends, which releases it as well
  }
}

// The time stamp is set by the machine that keeps the file (UTIME_NOW), as that of age_of() is.
void PointClaim::beat() const noexcept {
  if (!file_.empty()) ::utimensat(AT_FDCWD, file_.c_str(), nullptr, 0);
}

PointFolder::PointFolder(fs::path folder, PointPlan plan)
    : folder_(std::move(folder)), plan_(std::move(plan)) {}

// The list comes first and plan.json last: a folder with plan.json is a whole plan.
PointFolder PointFolder::create(const fs::path& folder, const PointPlan& plan) {
  std::unordered_set<std::string> keys;
  for (const PlannedPoint& point : plan.points)
    if (!keys.insert(point.key).second)
      throw SweepError("two points of the sweep are the same: " + dumped(point.what));
  const std::string lines = lines_of(plan.points);
  const std::string digest = sha256(lines);
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw SweepError(folder.string() + ": " + error.message());
  if (fs::exists(folder / "plan.json")) refuse_second(folder, digest);
  refuse_foreign(folder);
  PointPlan kept = plan;
  kept.head["version"] = kPlanVersion;
  kept.head["points"] = plan.points.size();
  kept.head["points_sha256"] = digest;
  publish(folder / lines_name(digest), lines);
  if (!publish_new(folder / "plan.json", kept.head.dump(1) + "\n")) refuse_second(folder, digest);
  return {fs::absolute(folder).lexically_normal(), std::move(kept)};
}

// Absolute from here on: what runs at the points may change the folder it is in.
PointFolder::PointFolder(const fs::path& folder)
    : folder_(fs::absolute(folder).lexically_normal()) {
  const fs::path file = folder_ / "plan.json";
  if (!fs::is_regular_file(file))
    throw SweepError(folder.string() + ": is no sweep: it has no plan.json");
  plan_.head = parsed_file(file);
  if (!plan_.head.is_object() || !plan_.head.contains("points_sha256"))
    throw SweepError(file.string() + ": is damaged, or no plan of a sweep");
  if (plan_.head.value("version", 0) != kPlanVersion)
    throw SweepError(fmt::format("{}: has version {}; this program reads {}", file.string(),
                                 plan_.head.value("version", 0), kPlanVersion));
  plan_.points = points_in(folder_ / lines_name(plan_.head.value("points_sha256", "")), plan_.head);
}

fs::path PointFolder::claim_file(std::size_t point, int generation) const {
  return folder_ / "claims" / shard_of(point) / fmt::format("{}.{}", name_of(point), generation);
}

fs::path PointFolder::mark_file(std::size_t point) const {
  return folder_ / "done" / shard_of(point) / (name_of(point) + ".json");
}

// In one folder as long as `vitreo runs` can list it; beyond that a thousand each.
fs::path PointFolder::runs_of(std::size_t point) const {
  return plan_.points.size() <= kFlat ? folder_ / "runs" : folder_ / "runs" / shard_of(point);
}

// Generations are never removed, so that the highest one is found by counting up, and of several
// that find its owner dead exactly one makes the next.
std::unique_ptr<PointClaim> PointFolder::claim(std::size_t point) const {
  int generation = 1;
  for (; fs::exists(claim_file(point, generation)); ++generation)
    if (!fs::exists(claim_file(point, generation + 1)) && !is_dead(claim_file(point, generation)))
      return nullptr;
  if (is_marked(point)) return nullptr;
  const fs::path file = claim_file(point, generation);
  fs::create_directories(file.parent_path());
  // Of several that found the owner dead, another one was first.
  if (!publish_new(file, this_owner().dump() + "\n")) return nullptr;
  auto claim = std::make_unique<PointClaim>(file, generation);
  // Its last owner may have finished between the two questions.
  if (is_marked(point)) return nullptr;
  return claim;
}

bool PointFolder::is_marked(std::size_t point) const { return fs::exists(mark_file(point)); }

// The first mark stays: a run that was done twice counts once.
bool PointFolder::mark(std::size_t point, const nlohmann::json& result) const {
  nlohmann::json mark = result;
  mark["key"] = points().at(point).key;
  fs::create_directories(mark_file(point).parent_path());
  return publish_new(mark_file(point), dumped(mark) + "\n");
}

// A mark has the key of its point, so that one that was copied from another sweep is found.
std::optional<nlohmann::json> PointFolder::result(std::size_t point) const {
  const fs::path file = mark_file(point);
  if (!fs::exists(file)) return std::nullopt;
  nlohmann::json mark = parsed_file(file);
  const std::string again = ": remove it, and --resume does the point again";
  if (!mark.is_object()) throw SweepError(file.string() + ": is damaged" + again);
  if (mark.value("key", "") != points().at(point).key)
    throw SweepError(file.string() + ": is of another sweep" + again);
  return mark;
}

// By the lists of the folders: asking for each of a million marks takes a million questions to the
// file server.
std::vector<std::size_t> PointFolder::unfinished() const {
  std::vector<bool> done(points().size(), false);
  for (std::size_t first = 0; first < points().size(); first += kShard) {
    const fs::path shard = mark_file(first).parent_path();
    std::error_code absent;
    for (const auto& entry : fs::directory_iterator(shard, absent)) {
      const std::string stem = entry.path().stem().string();
      if (entry.path().extension() != ".json" || stem.find_first_not_of("0123456789") != stem.npos)
        continue;
      const std::size_t point = std::stoul(stem);
      if (point < done.size()) done[point] = true;
    }
  }
  std::vector<std::size_t> left;
  for (std::size_t point = 0; point < done.size(); ++point)
    if (!done[point]) left.push_back(point);
  return left;
}

}  // namespace vitreo
