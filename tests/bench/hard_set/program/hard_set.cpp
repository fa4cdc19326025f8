// The hard set: a row a variant, over seeds and grounds: lost, wrong, px, inside, frames a second.
// hard_set [--photos FOLDER] [--seeds A-B] [--each N] [--variant PART] [--ground PART] [--from N]
//   [--until N] [--no-rim] [--network FILE] [--mixed SHARE] [--by-ground] [--frames]
//   [--into FILE [--minutes M]] [--repeats N]
// Variants count from 1. --each N: seed k is judged before N of the grounds only, others for each
// seed, so that all have their turn. --into FILE keeps every sequence's verdict as a line of CSV:
// what the file has is not judged again, so a long run can be made in parts of M minutes.
// --repeats N: times are each frame's least in N further runs (one robot): what a load takes from
// caches and cores is left out.
// hard_set --dump FOLDER ... writes the first matching sequence as frame_N.png and truth.csv.
// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/hard_set/judge.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace {

using namespace vitreo::hard_set;
using vitreo::vision::ObjectModel;

const cv::Size kView(640, 480);

struct Options {
  std::string photos;
  std::string variant;
  std::string ground;
  std::string dump;
  std::string into;
  std::string network;
  vitreo::vision::ColorModelSettings colors;
  std::uint64_t first_seed = 1;
  std::uint64_t last_seed = 1;
  std::size_t each = 100;
  double minutes = 1e9;
  int from = 1;
  int until = 1000;
  bool by_ground = false;
  JudgeSettings judge;
};

std::string bytes_of(const std::string& file) {
  std::ostringstream bytes;
  bytes << std::ifstream(file, std::ios::binary).rdbuf();
  return bytes.str();
}

Options options_of(int argc, char** argv) {
  Options options;
  const std::map<std::string, std::string Options::*> texts{
      {"--photos", &Options::photos}, {"--variant", &Options::variant},
      {"--ground", &Options::ground}, {"--dump", &Options::dump},
      {"--into", &Options::into},     {"--network", &Options::network}};
  for (int k = 1; k < argc; ++k) {
    const std::string name = argv[k];
    const auto value = [&]() -> std::string {
      if (k + 1 >= argc) throw std::runtime_error(name + ": wants a value");
      return argv[++k];
    };
    if (texts.contains(name)) {
      options.*texts.at(name) = value();
    } else if (name == "--seeds") {
      const std::string seeds = value();
      options.first_seed = std::stoull(seeds);
      options.last_seed = std::stoull(seeds.substr(seeds.find('-') + 1));
    } else if (name == "--each") {
      options.each = std::stoull(value());
    } else if (name == "--minutes") {
      options.minutes = std::stod(value());
    } else if (name == "--from") {
      options.from = std::stoi(value());
    } else if (name == "--until") {
      options.until = std::stoi(value());
    } else if (name == "--repeats") {
      options.judge.repeats = std::stoi(value());
    } else if (name == "--mixed") {
      options.colors.mixed = std::stod(value());
    } else if (name == "--no-rim") {
      options.judge.tracker.view.refine = false;
    } else if (name == "--frames") {
      options.judge.each_frame = true;
    } else if (name == "--by-ground") {
      options.by_ground = true;
    } else {
      throw std::runtime_error(name + ": is no option; see the head of hard_set.cpp");
    }
  }
  if (!options.network.empty()) options.network = bytes_of(options.network);
  return options;
}

void print_head() {
  std::printf("%-30s %5s %5s %5s %5s %6s %12s %6s %6s %6s %8s\n", "", "shown", "lost", "wrong",
              ">5 s", "px", "bias px", "inside", "found", "fps", "worst us");
}

// fps: of update() alone, by CPU time. found: most frames until a robot in view was tracked.
void print_row(const std::string& name, const Verdict& v) {
  std::printf("%-30s %5d %5d %5d %5d %6.2f %5.2f, %5.2f %5.0f%% %6d %6.0f %8.0f\n", name.c_str(),
              v.shown, v.lost, v.wrong, v.beyond_sigma, v.there > 0 ? v.off_px / v.there : 0,
              v.there > 0 ? v.du / v.there : 0, v.there > 0 ? v.dv / v.there : 0,
              v.there > 0 ? 100.0 * v.inside / v.there : 0, v.found_after, v.frames / v.seconds,
              1e6 * v.worst_seconds);
  std::fflush(stdout);
}

// Verdicts of single sequences by seed, variant and ground, and a file of them, of which a broken
// last line is not read.
class Results {
 public:
  using Key = std::tuple<std::uint64_t, int, std::string>;
  explicit Results(const std::string& file) : file_(file) {
    std::ifstream in(file);
    for (std::string line; std::getline(in, line);)
      if (const auto one = read(line)) verdicts_[one->first] = one->second;
  }
  bool has(const Key& key) const { return verdicts_.contains(key); }
  void add(const Key& key, const Verdict& v) {
    verdicts_[key] = v;
    if (file_.empty()) return;
    std::ofstream out(file_, std::ios::app);
    out << std::get<0>(key) << ';' << std::get<1>(key) << ';' << std::get<2>(key);
    for (const double value :
         {double(v.shown), double(v.lost), double(v.tracked), double(v.wrong),
          double(v.beyond_sigma), double(v.inside), double(v.there), double(v.found_after), v.du,
          v.dv, v.off_px, v.seconds, v.worst_seconds, double(v.frames)})
      out << ';' << value;
    out << '\n';
  }
  void print(bool by_ground) const {
    print_head();
    Verdict all;
    int number = 0;
    for (const Variant& variant : all_variants()) {
      ++number;
      std::map<std::string, Verdict> grounds;
      Verdict sum;
      for (const auto& [key, verdict] : verdicts_) {
        if (std::get<1>(key) != number) continue;
        grounds[std::get<2>(key)].add(verdict);
        sum.add(verdict);
      }
      if (grounds.empty()) continue;
      if (by_ground)
        for (const auto& [name, verdict] : grounds) print_row("  " + name, verdict);
      print_row(variant.name, sum);
      all.add(sum);
    }
    print_row("all", all);
  }

 private:
  static std::optional<std::pair<Key, Verdict>> read(const std::string& line) {
    std::istringstream in(line);
    std::string ground;
    std::string number;
    std::string seed;
    std::getline(in, seed, ';');
    std::getline(in, number, ';');
    std::getline(in, ground, ';');
    Verdict v;
    for (int* value : {&v.shown, &v.lost, &v.tracked, &v.wrong, &v.beyond_sigma, &v.inside,
                       &v.there, &v.found_after})
      in >> *value, in.ignore(1, ';');
    for (double* value : {&v.du, &v.dv, &v.off_px, &v.seconds, &v.worst_seconds})
      in >> *value, in.ignore(1, ';');
    if (!(in >> v.frames)) return std::nullopt;
    return std::pair{Key{std::stoull(seed), std::stoi(number), ground}, v};
  }
  std::string file_;
  std::map<Key, Verdict> verdicts_;
};

// The frames, their truth and the training images, as track_sequence reads them.
void dump(const Scene& scene, const std::vector<vitreo::vision::LabeledImage>& training,
          const std::string& folder) {
  std::ofstream truth(folder + "/truth.csv");
  truth << "frame,cx,cy,A,B,phi_deg,visible\n";
  for (int k = 0; k < Scene::kFrames; ++k) {
    const Shot shot = scene.shot(k);
    cv::imwrite(folder + "/frame_" + std::to_string(k) + ".png", shot.image);
    const vitreo::vision::Ellipse& e = shot.truth;
    truth << k << ',' << e.center_px.x() << ',' << e.center_px.y() << ',' << 2 * e.semi_major_px
          << ',' << 2 * e.semi_minor_px << ',' << e.angle * 180 / CV_PI << ',' << shot.visible
          << '\n';
  }
  int n = 0;
  for (const vitreo::vision::LabeledImage& one : training) {
    const std::string name = folder + "/training_" + std::to_string(n++);
    cv::imwrite(name + ".png", one.image);
    cv::imwrite(name + "_mask.png", one.mask);
  }
}

// All variants before one ground of one seed. The seed of a sequence depends on the numbers of its
// variant and its ground alone, so that a row can be repeated by itself.
class GroundRun {
 public:
  GroundRun(const Options& options, std::uint64_t seed, std::size_t number, const Ground& ground)
      : options_(options), seed_(seed), number_(number), ground_(ground) {}

  // False once the time is over, or the one sequence asked for is written.
  bool judge_all(Results& results, std::chrono::steady_clock::time_point until) {
    int number = 0;
    for (const Variant& variant : all_variants()) {
      ++number;
      if (number < options_.from || number > options_.until) continue;
      if (variant.name.find(options_.variant) == std::string::npos) continue;
      const Results::Key key{seed_, number, ground_.name};
      if (results.has(key)) continue;
      if (std::chrono::steady_clock::now() > until) return false;
      const std::uint64_t seed = 100 * seed_ + 16 * static_cast<std::uint64_t>(number) + number_;
      const Scene scene(ground_, variant, seed, kView);
      if (!options_.dump.empty()) {
        dump(scene, training_of(ground_, variant, training_seed(variant, seed), kView),
             options_.dump);
        return false;
      }
      results.add(key, judge(scene, model_for(variant, seed), options_.judge));
    }
    return true;
  }

 private:
  std::uint64_t training_seed(const Variant& variant, std::uint64_t seed) const {
    return trained_as_plain(variant) ? 100 * seed_ + number_ : seed;
  }
  ObjectModel model_for(const Variant& variant, std::uint64_t seed) {
    const auto trained = [&] {
      return ObjectModel::train(training_of(ground_, variant, training_seed(variant, seed), kView),
                                options_.colors, options_.judge.tracker.view, options_.network);
    };
    if (!trained_as_plain(variant)) return trained();
    if (!plain_) plain_ = trained();
    return *plain_;
  }
  const Options& options_;
  std::uint64_t seed_;
  std::uint64_t number_;
  const Ground& ground_;
  std::optional<ObjectModel> plain_;
};

void run(const Options& options) {
  using Clock = std::chrono::steady_clock;
  const auto until = options.minutes > 1e6
                         ? Clock::time_point::max()
                         : Clock::now() + std::chrono::seconds(std::lround(60 * options.minutes));
  if (options.photos.empty()) std::printf("no --photos: generated grounds alone\n");
  Results results(options.into);
  bool more = true;
  for (std::uint64_t seed = options.first_seed; more && seed <= options.last_seed; ++seed) {
    std::vector<Ground> grounds = generated_grounds(seed, kView);
    if (!options.photos.empty())
      for (Ground& one : photographed_grounds(options.photos, kView))
        grounds.push_back(std::move(one));
    const std::size_t count = std::min(options.each, grounds.size());
    for (std::size_t k = 0; more && k < count; ++k) {
      // Five and twelve have no divisor in common: photographs and generated grounds in turn.
      const std::size_t g =
          count < grounds.size() ? (5 * (count * (seed - 1) + k)) % grounds.size() : k;
      if (grounds[g].name.find(options.ground) == std::string::npos) continue;
      more = GroundRun(options, seed, g, grounds[g]).judge_all(results, until);
    }
  }
  if (options.dump.empty()) results.print(options.by_ground);
  if (!more && options.dump.empty()) std::printf("not finished: the time is over\n");
}

}  // namespace

int main(int argc, char** argv) {
  try {
    cv::setNumThreads(1);
    run(options_of(argc, argv));
    return 0;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "hard_set: %s\n", e.what());
    return 1;
  }
}
