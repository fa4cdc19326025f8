// The hard set: a row a variant, over all grounds: lost, wrong, px, inside, frames a second.
// hard_set [--photos FOLDER] [--seed N] [--variant PART] [--ground PART] [--from N] [--until N]
//   [--no-rim] [--by-ground] [--frames]; variants count from 1.
// hard_set --dump FOLDER ... writes the first matching sequence as frame_N.png and truth.csv.
// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/hard_set/judge.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <stdexcept>
#include <string>

namespace {

using namespace vitreo::hard_set;

const cv::Size kView(640, 480);

struct Options {
  std::string photos;
  std::string variant;
  std::string ground;
  std::string dump;
  std::uint64_t seed = 1;
  int from = 1;
  int until = 1000;
  bool by_ground = false;
  JudgeSettings judge;
};

Options options_of(int argc, char** argv) {
  Options options;
  for (int k = 1; k < argc; ++k) {
    const std::string name = argv[k];
    const auto value = [&]() -> std::string {
      if (k + 1 >= argc) throw std::runtime_error(name + ": wants a value");
      return argv[++k];
    };
    if (name == "--photos")
      options.photos = value();
    else if (name == "--variant")
      options.variant = value();
    else if (name == "--ground")
      options.ground = value();
    else if (name == "--dump")
      options.dump = value();
    else if (name == "--seed")
      options.seed = std::stoull(value());
    else if (name == "--from")
      options.from = std::stoi(value());
    else if (name == "--until")
      options.until = std::stoi(value());
    else if (name == "--no-rim")
      options.judge.tracker.view.refine = false;
    else if (name == "--frames")
      options.judge.each_frame = true;
    else if (name == "--by-ground")
      options.by_ground = true;
    else
      throw std::runtime_error(name + ": is no option; see the head of hard_set.cpp");
  }
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

// The frames, their truth and the training images, as track_sequence reads them.
void dump(const Scene& scene, const std::string& folder) {
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
  for (const vitreo::vision::LabeledImage& one : scene.training()) {
    const std::string name = folder + "/training_" + std::to_string(n++);
    cv::imwrite(name + ".png", one.image);
    cv::imwrite(name + "_mask.png", one.mask);
  }
}

// The seed of a sequence depends on the numbers of its variant and its ground alone, so that a row
// can be repeated by itself.
void run(const Options& options) {
  std::vector<Ground> grounds = generated_grounds(options.seed, kView);
  if (!options.photos.empty())
    for (Ground& one : photographed_grounds(options.photos, kView))
      grounds.push_back(std::move(one));
  if (options.photos.empty()) std::printf("no --photos: generated grounds alone\n");
  print_head();
  Verdict all;
  std::uint64_t seed = 100 * options.seed;
  int number = 0;
  for (const Variant& variant : all_variants()) {
    seed += 16;
    ++number;
    if (number < options.from || number > options.until) continue;
    if (variant.name.find(options.variant) == std::string::npos) continue;
    Verdict sum;
    for (std::size_t g = 0; g < grounds.size(); ++g) {
      if (grounds[g].name.find(options.ground) == std::string::npos) continue;
      const Scene scene(grounds[g], variant, seed + g, kView);
      if (!options.dump.empty()) return dump(scene, options.dump);
      const Verdict one = judge(scene, options.judge);
      if (options.by_ground) print_row("  " + grounds[g].name, one);
      sum.add(one);
    }
    print_row(variant.name, sum);
    all.add(sum);
  }
  print_row("all", all);
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
