// Features of a camera as scripts have them: numbers, texts, flags and commands by their names.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

#include <map>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// GenICam's features are texts; each access takes a while, as over a network.
class FeaturedCamera final : public TickingCamera {
 public:
  explicit FeaturedCamera(Clock& clock) : TickingCamera(clock), clock_(clock) {}
  std::string feature(const std::string& name) override {
    clock_.sleep_for(50ms);
    const auto found = features.find(name);
    if (found == features.end())
      throw DeviceError(DeviceErrorKind::refused, "top_camera", "has no feature " + name);
    return found->second;
  }
  std::string set_feature(const std::string& name, const std::string& value) override {
    if (value == "Sideways")
      throw DeviceError(DeviceErrorKind::refused, "top_camera",
                        "feature " + name + ": wants Off or Once; got Sideways");
    feature(name);
    return features[name] = value;
  }
  std::map<std::string, std::string> features{{"Gain", "3.5"},
                                              {"ReverseX", "false"},
                                              {"GainAuto", "Off"},
                                              {"DeviceSerialNumber", "00x17"},
                                              {"TriggerSoftware", "untouched"}};

 private:
  Clock& clock_;
};

class CameraFeature : public LuaBench {
 protected:
  CameraFeature() { rig.top_camera = &camera; }
  FeaturedCamera camera{*clock};
};

TEST_F(CameraFeature, ComesAsWhatItsTextSays) {
  EXPECT_EQ(run("local camera = rig.top_camera\n"
                "assert(camera:feature('Gain') == 3.5)\n"
                "assert(camera:feature('ReverseX') == false)\n"
                "assert(camera:feature('GainAuto') == 'Off')\n"
                "assert(camera:feature('DeviceSerialNumber') == '00x17')")
                .error,
            "");
}

TEST_F(CameraFeature, IsSetFromANumberAFlagATextAndACommandFromNothing) {
  EXPECT_EQ(run("local camera = rig.top_camera\n"
                "camera:set_feature('Gain', 6) camera:set_feature('ReverseX', true)\n"
                "camera:set_feature('GainAuto', 'Once') camera:set_feature('TriggerSoftware')")
                .error,
            "");
  EXPECT_EQ(camera.features["Gain"], "6");
  EXPECT_EQ(camera.features["ReverseX"], "true");
  EXPECT_EQ(camera.features["GainAuto"], "Once");
  EXPECT_EQ(camera.features["TriggerSoftware"], "");
}

TEST_F(CameraFeature, AWrongNameOrValueIsTheCamerasOwnErrorAndChangesNothing) {
  const auto before = camera.features;
  for (const auto& [words, why] : std::map<std::string, std::string>{
           {"feature('Gian')", "has no feature Gian"},
           {"set_feature('GainAuto', 'Sideways')", "wants Off or Once; got Sideways"},
           {"set_feature('Gain', {})", "value: must be a number, a text, true or false"},
           {"feature(3, 4)", ""}}) {
    const std::string error = run("rig.top_camera:" + words).error;
    EXPECT_NE(error, "") << words;
    EXPECT_NE(error.find(why), std::string::npos) << error;
  }
  EXPECT_EQ(camera.features, before);
}

TEST_F(CameraFeature, TheScriptGoesOnWhileTheCameraAnswers) {
  EXPECT_EQ(run("local order = ''\n"
                "run:together(function() rig.top_camera:feature('Gain') order = order .. 'camera' "
                "end, function() run:wait(0.01) order = order .. 'script ' end)\n"
                "assert(order == 'script camera', order)")
                .error,
            "");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
