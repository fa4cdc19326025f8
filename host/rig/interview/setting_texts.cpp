// SPDX-License-Identifier: Apache-2.0
#include "host/rig/interview/setting_texts.h"

#include "host/rig/identities.h"

#include <map>

namespace vitreo {
namespace {

using Texts = std::vector<SettingText>;

const SettingText kBaudRate{
    "baud_rate", "rate of the line, in baud",
    "As it is set at the instrument's panel, or as --ask has found it. With another rate the line "
    "is silent, or says nonsense."};
const SettingText kTotalCurrent{
    "interlock_total_current", "largest sum of all coils' currents",
    "The interlock refuses more, and brings the coils to zero. It is what the common supply and "
    "the cooling of the coils bear: sum of the currents of all channels without their signs."};
const SettingText kCurrentLimit{
    "current_limit", "largest current of one coil",
    "Amplifier and interlock refuse more. Take the least of: what the coil's data sheet allows for "
    "as long as a run lasts, what the amplifier gives, what the cables bear.",
    Need::typed, "1 A"};

const std::vector<SettingText> kCameraTexts{
    {"width_px", "width of its images, in pixels",
     "Of the images as the camera sends them. `vitreo devices --ask genicam` prints it, and so "
     "does "
     "the camera's data sheet.",
     Need::typed, "640"},
    {"height_px", "height of its images, in pixels", "As the width.", Need::typed, "480"},
    {"frame_rate", "images a second",
     "The servo loop runs at this rate. The camera's exposure must fit in, and so must all that "
     "the "
     "coils' links take: `vitreo check` computes it. 15 Hz is usual."},
    {"exposure", "exposure of one image",
     "The camera's own time of exposure, shorter than the time from one image to the next. It adds "
     "to the delay of the loop by its half."},
    {"effective_pixel", "width of one pixel in the plane that it looks at",
     "Put a ruled slide where the robot is (of the top camera with the eye: where the aerial image "
     "is), count the pixels of a known length, and divide. Every position is computed with it: 5 % "
     "wrong here are 5 % wrong in each result. `calibrate_cameras` refines it.",
     Need::typed, "10 um"}};

const std::vector<SettingText> kTravel{
    {"travel_min", "lowest position of x, y and z",
     "From the instrument's own origin. Motions that would go lower are refused. Narrow it to "
     "where "
     "the stage hits neither eye, lens nor coils; drive there slowly by hand to find out.",
     Need::typed, "-1, -1, -1 mm"},
    {"travel_max", "highest position of x, y and z", "As the lowest.", Need::typed, "1, 1, 1 mm"},
    {"speed", "usual speed of a motion", "A script may ask for another, up to max_speed."}};

const std::vector<SettingText> kStage{
    {"carries", "what stands on it: sensor (microscope with its camera), probe, or nothing",
     "The dry run and the emulated laboratory move it along. The real stage moves what is on it, "
     "whatever stands here.",
     Need::typed, "nothing"},
    {"focus_axis", "which of its axes changes the focus",
     "The axis along the microscope's light. Autofocus moves it and no other: a wrong letter "
     "drives "
     "the stage sideways, or into the eye.",
     Need::typed, "z"}};

Texts joined(std::initializer_list<Texts> parts) {
  Texts all;
  for (const Texts& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

Texts usb3103_texts() {
  return {
      {"amperes_per_volt", "current of the amplifiers for one volt at their input, in A per V",
       "From the amplifiers' manual, or measured: it must be the same for all eight. The "
       "USB-3103 puts out up to 10 V either way. Twice too small a number here gives twice the "
       "current that a script asks for, and the interlock cannot notice.",
       Need::typed, "2"},
      kCurrentLimit,
      kTotalCurrent,
      {"enable_line", "digital line that enables the amplifiers, 0 to 7",
       "High with the first currents, low with every end. The USB-3103 has no watchdog: when the "
       "host dies this line, with the emergency stop in series, is what takes the current away. "
       "none: the amplifiers are always on.",
       Need::optional, "0"}};
}

Texts kepco_texts() {
  return {kCurrentLimit,
          {"voltage_limit", "largest voltage of one supply",
           "In a step of current a coil needs more than at rest: L dI/dt on top of R I. The supply "
           "limits to this, which protects the coil's insulation.",
           Need::typed, "10 V"},
          {"max_slope", "fastest change of a coil's current",
           "Larger steps are made as a ramp. Slope times inductance must stay below the voltage "
           "limit: 200 A/s in 50 mH are 10 V."},
          kTotalCurrent,
          kBaudRate};
}

Texts tic_texts() {
  return {{"step_length", "travel of the lens for one full step of the motor",
           "The spindle's lead divided by the motor's steps a turn: 1 mm and 200 steps are 5 um. "
           "Negative where forward is towards the eye.",
           Need::typed, "5 um"},
          {"usteps_per_step", "microsteps in a full step: 1, 2, 4, 8, 16 or 32",
           "As the controller shall be set. It is written to it where it differs."},
          {"travel", "travel from the middle, either way",
           "Moves beyond are refused. Take what the spindle allows between its end stops, less a "
           "millimeter: beyond it the lens is pressed against the eye.",
           Need::typed, "1 mm"},
          {"speed", "usual speed of the lens", "The motor must follow it without losing steps."},
          {"current_limit", "current of the motor's windings",
           "From the motor's data sheet. Too much burns it, too little loses steps.", Need::typed,
           "0.5 A"},
          {"home", "where its limit switch is: reverse, forward, or none",
           "Without a limit switch `none`: homing would drive into the end stop.", Need::typed,
           "reverse"},
          {"command_timeout", "time after which the motor stops when the host falls silent",
           "The controller's own watchdog. Short is safe; below the pause between two commands the "
           "motor stutters."}};
}

Texts led_texts() {
  return {{"output", "analog output that dims the LEDs, 0 to 7", "Of the USB-3103 of the lamp."},
          {"amperes_per_volt", "current of the LEDs for one volt, in A per V",
           "Of the current source behind the output.", Need::typed, "0.1"},
          {"full_current", "current of the LEDs at level 1",
           "What the eye and the LEDs bear for as long as a run lasts: level 1 is the most that a "
           "script can ask for.",
           Need::typed, "0.1 A"},
          {"level", "level at the begin of a run, 0 (dark) to 1", "Scripts change it."},
          {"enable_line", "digital line that enables the current source, 0 to 7",
           "none: it is always on.", Need::optional, "0"}};
}

Texts probe_texts() {
  return {
      {"question", "what asks it for the field", "The query of its manual, such as MEAS?.",
       Need::typed, "MEAS?"},
      {"unit", "field for a 1 in its answers",
       "1 mT where it answers in millitesla, 0.1 mT in gauss. Ten times wrong here is ten times "
       "wrong in the coils' calibration.",
       Need::typed, "1 mT"},
      {"range", "largest field that it measures", "Beyond, a reading is refused.", Need::typed,
       "1 T"},
      {"axes", "numbers in one answer: 1 or 3", "1: along z."},
      {"on_stage", "whether the stage carries it", "For the dry run and the emulated laboratory."},
      kBaudRate};
}

/// Of a linear or a rotary axis.
Texts axis_texts(const char* step, const char* low, const char* high) {
  return {
      {"axis", "which axis of its device", "1 but for controllers of several axes."},
      {"device", "number of its device in the chain",
       "As `vitreo devices --ask` prints it, from 1."},
      {"step", "travel for one full step of its motor",
       "From the data sheet. Lengths are wrong by what it is wrong by; the microsteps in it are "
       "asked for.",
       Need::typed, step},
      {"travel_min", "lowest position, none: the instrument's own",
       "Motions that would go lower are refused. Narrow it to where nothing is hit.",
       Need::optional, low},
      {"travel_max", "highest position, none: the instrument's own", "As the lowest.",
       Need::optional, high},
      {"speed", "usual speed of a motion", "A script may ask for another, up to max_speed."}};
}

Texts pedal_texts() {
  return {
      {"layout", "how it tells its pedals",
       "xkeys_xk3 and xkeys_xk3_0438 are PI Engineering's, by their product number; infinity is "
       "a VEC Infinity."},
      {"dead_man", "pedals that must be held while current flows, counted from 1",
       "2: no current flows unless pedal 2 is held; released or unplugged means zero. none: the "
       "pedal is for scripts alone."}};
}

const std::map<std::string, Texts>& all_texts() {
  static const std::map<std::string, Texts> texts{
      {"model",
       {{"eye", "optics of the eye in front of the robot",
         "model_eye_5_3: the two-lens model eye of the thesis; navarro_condensing: a human eye "
         "with a "
         "condensing lens; porcine_condensing: a pig's behind that lens. Positions in the top "
         "camera are computed through it."},
        {"robot", "magnetic robot",
         "Its size, weight and magnetization: the loop computes the currents with them."},
        {"calibration", "file of the measured field of the coils (YAML), none: computed dipoles",
         "As ETH's software for electromagnets writes it, or calibrate_coils. Computed dipoles are "
         "enough to try, and wrong by tens of percent on a real magnet."}}},
      {"genicam", kCameraTexts},
      {"iidc", kCameraTexts},
      {"opencv_camera", {kCameraTexts[0], kCameraTexts[1], kCameraTexts[2], kCameraTexts[4]}},
      {"usb3103", usb3103_texts()},
      {"kepco_bop", kepco_texts()},
      {"sutter_mp285", joined({kStage, kTravel, {kBaudRate}})},
      {"sutter_mpc200",
       joined({{{"drive", "which of the controller's drives, 1 to 4", "As its panel shows."}},
               kStage,
               {{"travel_min", "lowest position of x, y and z, from 0", kTravel[0].help,
                 Need::typed, "1, 1, 1 mm"},
                {"travel_max", "highest position of x, y and z, to 25 mm", kTravel[1].help,
                 Need::typed, "2, 2, 2 mm"},
                kTravel[2]}})},
      {"zaber", kStage},
      {"rotation_stage zaber", joined({axis_texts("0.3 deg", "0 deg", "1 deg"), {kBaudRate}})},
      {"pololu_tic", tic_texts()},
      {"led", led_texts()},
      {"foot_pedal", pedal_texts()},
      {"scpi_probe", probe_texts()},
      // Of a driver that is a Lua file, beside what the file declares.
      {"stage lua", kStage},
      {"coils lua", {kTotalCurrent}},
      {"lamp lua",
       {{"level", "level at the begin of a run, 0 (dark) to 1", "Scripts change it."}}}};
  return texts;
}

}  // namespace

const std::vector<SettingText>& setting_texts(const std::string& role, const std::string& driver) {
  static const Texts none;
  const bool built_in = is_built_in(driver);
  for (const std::string& name :
       {role + " " + driver, driver.empty() ? role : driver, built_in ? "" : role + " lua"})
    if (const auto found = all_texts().find(name); found != all_texts().end()) return found->second;
  return none;
}

const std::vector<SettingText>& zaber_axis_texts() {
  static const Texts texts = axis_texts("3 um", "0 mm", "1 mm");
  return texts;
}

const std::vector<RoleText>& role_texts() {
  static const std::vector<RoleText> roles{
      {"top_camera", "the camera on the microscope, through which the robot is steered"},
      {"side_camera", "a camera from the side, by which protocols judge (hold wants one)"},
      {"coils", "the amplifiers of the electromagnets"},
      {"stage", "the stage that carries the microscope or a probe"},
      {"lens_mover", "the motor of the lens in front of the eye (BIOM)"},
      {"lamp", "the light in the eye"},
      {"joystick", "a SpaceMouse in the operator's hand"},
      {"pedal", "foot pedals, also as a dead-man switch"},
      {"field_probe", "a teslameter, for calibrating the coils"},
      {"rotation_stage", "a turntable"}};
  return roles;
}

std::string example_address(const std::string& driver) {
  static const std::map<std::string, std::string> examples{
      {"genicam", "genicam:192.168.1.7"},     {"iidc", "iidc:any"},
      {"opencv_camera", "video:/dev/video0"}, {"image_sequence", "images:FOLDER"},
      {"usb3103", "hid:09db:009c"},           {"led", "hid:09db:009c:SERIAL"},
      {"pololu_tic", "usb:1ffb:00b3"},        {"spacemouse", "hid:256f:c635"},
      {"foot_pedal", "hid:05f3:0268"},        {"kepco_bop", "tcp:10.0.0.11:5025"},
      {"scpi_probe", "tcp:10.0.0.7:7777"}};
  const auto found = examples.find(driver);
  return found == examples.end() ? "serial:/dev/ttyUSB0" : found->second;
}

}  // namespace vitreo
