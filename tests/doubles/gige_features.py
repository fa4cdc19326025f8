"""The features of the GigE Vision camera double: one table, from which its registers and its GenApi text are made.

Names and meanings are those of the Standard Features Naming Convention, as Aravis (src/arvcamera.c, arvgvdevice.c) and
the project's fact sheet on cameras use them; the addresses are this camera's own. The elements of the GenApi text are
those that Aravis 0.8.26 reads (src/arvgc*.c) and that its own fake camera's text shows.
SPDX-License-Identifier: Apache-2.0
"""

from xml.sax.saxutils import escape

import gige_scene

BASE = 0x10000
XML_ADDRESS = 0x100000


class Feature:
    """One feature. kind: int, long, float, enum, bool, command, string.

    least, most, step: fixed limits; span: (least, most) as formulas of other features; entries: name -> value;
    per: the name of the selector; slots: how many it selects; age: "new", "old" or "" (both); still: refused while
    the camera acquires; auto: the enumeration that locks it when it is not Off; lasting: part of a user set.
    """

    def __init__(self, name, kind, value=0, **more):
        self.name, self.kind, self.value = name, kind, value
        self.category = ""
        self.least, self.most, self.step = more.pop("least", None), more.pop("most", None), more.pop("step", None)
        self.span, self.entries = more.pop("span", None), more.pop("entries", None)
        self.per, self.slots = more.pop("per", None), more.pop("slots", 1)
        self.age, self.unit = more.pop("age", ""), more.pop("unit", None)
        self.access = more.pop("access", "WO" if kind == "command" else "RW")
        self.still, self.auto = more.pop("still", False), more.pop("auto", None)
        self.address, self.command = more.pop("address", None), more.pop("command", 1)
        self.color, self.length = more.pop("color", None), more.pop("length", 16)
        self.local, self.lasting = more.pop("local", False), more.pop("lasting", kind != "command")
        self.formula = more.pop("formula", None)
        assert not more, more

    def size(self):
        """Bytes of its register."""
        return {"long": 8, "float": 8, "string": self.length}.get(self.kind, 4)


def switch(name, *entries, value=0, first=0, **more):
    """An enumeration whose entries count up."""
    return Feature(name, "enum", value, entries={each: first + at for at, each in enumerate(entries)}, **more)


OFF_ON = ("Off", "On")
AUTO = ("Off", "Once", "Continuous")
TRIGGERS = ("AcquisitionStart", "FrameStart")
SOURCES = ("Software", "Line1")
LINES = ("Line1", "Line2")
CHUNKS = {  # name: (id, length); no source: ids are each maker's own
    "Timestamp": (0x00000A01, 8), "ExposureTime": (0x00000A02, 8), "FrameID": (0x00000A03, 8), "Gain": (0x00000A04, 8),
    "LineStatusAll": (0x00000A05, 4),
}
CHUNK_IMAGE = 0x00000A00
SETS = ("Default", "UserSet1")
PTP_STATES = ("Initializing", "Faulty", "Disabled", "Listening", "PreMaster", "Master", "Passive", "Uncalibrated",
              "Slave")


def table(camera):
    """The categories and their features; camera: anything with the options of the double."""
    width, height = camera.sensor_width, camera.sensor_height
    pixel_formats = {name: number for name, (number, _, filters) in gige_scene.FORMATS.items()
                     if (filters is None) != camera.color or name == "Mono8"}
    return {
        "DeviceControl": _device(),
        "ImageFormatControl": [
            Feature("SensorWidth", "int", width, access="RO"),
            Feature("SensorHeight", "int", height, access="RO"),
            Feature("WidthMax", "int", width, access="RO"),
            Feature("HeightMax", "int", height, access="RO"),
            Feature("Width", "int", width, step=camera.width_step, still=True,
                    span=(str(camera.width_step), "WidthMax - OffsetX")),
            Feature("Height", "int", height, step=camera.height_step, still=True,
                    span=(str(camera.height_step), "HeightMax - OffsetY")),
            Feature("OffsetX", "int", 0, step=camera.offset_step, span=("0", "WidthMax - Width")),
            Feature("OffsetY", "int", 0, step=camera.offset_step, span=("0", "HeightMax - Height")),
            Feature("ReverseX", "bool", 0, still=True),
            Feature("ReverseY", "bool", 0, still=True),
            Feature("PixelFormat", "enum", pixel_formats["BayerRG8" if camera.color else "Mono8"],
                    entries=pixel_formats, still=True),
        ],
        "AcquisitionControl": _acquisition() + _trigger(),
        "AnalogControl": _analog(),
        "DigitalIOControl": _lines(),
        "ChunkDataControl": [
            Feature("ChunkModeActive", "bool", 0, still=True),
            switch("ChunkSelector", *CHUNKS, local=True),
            Feature("ChunkEnable", "bool", 0, per="ChunkSelector", slots=len(CHUNKS), still=True),
        ],
        "UserSetControl": [
            switch("UserSetSelector", *SETS, lasting=False),
            Feature("UserSetLoad", "command", still=True),
            Feature("UserSetSave", "command", still=True),
            switch("UserSetDefault", *SETS, lasting=False),
        ],
        "TransportLayerControl": _transport(camera),
    }


def _device():
    def text(name, address, length, access="RO"):
        return Feature(name, "string", "", address=address, length=length, access=access, lasting=False)

    return [
        text("DeviceVendorName", 0x48, 32), text("DeviceModelName", 0x68, 32), text("DeviceVersion", 0x88, 32),
        text("DeviceManufacturerInfo", 0xA8, 48), text("DeviceSerialNumber", 0xD8, 16), text("DeviceID", 0xD8, 16),
        text("DeviceUserID", 0xE8, 16, "RW"),
        Feature("DeviceTemperature", "float", 41.5, access="RO", unit="C"),
        Feature("DeviceReset", "command"),
        Feature("TimestampLatch", "command", address=0x944, command=2, age="new"),
        Feature("TimestampReset", "command", address=0x944, command=1, age="new"),
        Feature("TimestampTicks", "long", address=0x948, access="RO", age="new"),
        # SFNC counts in nanoseconds; no source at hand but memory, so the driver is better off with the registers.
        Feature("TimestampLatchValue", "int", access="RO", age="new", unit="ns",
                formula="(TimestampTicks / GevTimestampTickFrequency) * 1000000000 + "
                        "((TimestampTicks % GevTimestampTickFrequency) * 1000000000) / GevTimestampTickFrequency"),
        Feature("GevTimestampTickFrequency", "long", address=0x93C, access="RO", unit="Hz"),
    ]


def _acquisition():
    return [
        switch("AcquisitionMode", "Continuous", "SingleFrame", "MultiFrame"),
        Feature("AcquisitionStart", "command"), Feature("AcquisitionStop", "command"),
        Feature("AcquisitionAbort", "command"),
        Feature("AcquisitionFrameCount", "int", 1, least=1, most=65535),
        Feature("AcquisitionFrameRateEnable", "bool", 0),
        Feature("AcquisitionFrameRateMax", "float", access="RO", unit="Hz"),
        Feature("AcquisitionFrameRate", "float", 30.0, span=("0.1", "AcquisitionFrameRateMax"), unit="Hz", age="new"),
        Feature("AcquisitionFrameRateAbs", "float", 30.0, span=("0.1", "AcquisitionFrameRateMax"), unit="Hz",
                age="old"),
        Feature("ResultingFrameRate", "float", access="RO", unit="Hz"),
        switch("ExposureMode", "Timed", first=1, value=1),
        Feature("ExposureTime", "float", 5000.0, least=20.0, most=1e6, unit="us", auto="ExposureAuto", age="new"),
        Feature("ExposureTimeAbs", "float", 5000.0, least=20.0, most=1e6, unit="us", auto="ExposureAuto", age="old"),
        switch("ExposureAuto", *AUTO, value=2),
    ]


def _trigger():
    slots = {"per": "TriggerSelector", "slots": len(TRIGGERS)}
    return [
        switch("TriggerSelector", *TRIGGERS, value=1, local=True),
        switch("TriggerMode", *OFF_ON, **slots),
        switch("TriggerSource", *SOURCES, **slots),
        switch("TriggerActivation", "RisingEdge", "FallingEdge", "AnyEdge", **slots),
        Feature("TriggerDelay", "float", 0.0, least=0.0, most=1e6, unit="us", age="new", **slots),
        Feature("TriggerDelayAbs", "float", 0.0, least=0.0, most=1e6, unit="us", age="old", **slots),
        Feature("TriggerSoftware", "command", **slots),
    ]


def _analog():
    return [
        Feature("Gain", "float", 0.0, least=0.0, most=24.0, unit="dB", auto="GainAuto", age="new"),
        Feature("GainRaw", "int", 0, least=0, most=240, auto="GainAuto", age="old"),
        switch("GainAuto", *AUTO, value=2),
        Feature("BlackLevel", "float", 64.0, least=0.0, most=511.0, age="new"),
        Feature("BlackLevelRaw", "int", 64, least=0, most=511, age="old"),
        Feature("Gamma", "float", 0.8, least=0.25, most=4.0),
        switch("BalanceRatioSelector", "Red", "Green", "Blue", local=True, color=True),
        Feature("BalanceRatio", "float", 1.0, least=0.25, most=8.0, per="BalanceRatioSelector", slots=3,
                auto="BalanceWhiteAuto", color=True),
        switch("BalanceWhiteAuto", *AUTO, value=2, color=True),
    ]


def _lines():
    slots = {"per": "LineSelector", "slots": len(LINES)}
    return [
        switch("LineSelector", *LINES, local=True),
        switch("LineMode", "Input", "Output", **slots),
        Feature("LineInverter", "bool", 0, **slots),
        Feature("LineStatus", "bool", 0, access="RO", **slots),
        switch("LineSource", "Off", "ExposureActive", "UserOutput0", **slots),
        Feature("LineStatusAll", "int", 0, access="RO"),
        Feature("UserOutputValue", "bool", 0),
    ]


def _transport(camera):
    return [
        Feature("PayloadSize", "int", access="RO"),
        Feature("GevSCPSPacketSize", "int", address=0xD04, least=576, most=camera.mtu, step=4, still=True,
                lasting=False),
        Feature("GevSCPSFireTestPacket", "command", address=0xD04, access="RW", lasting=False),
        Feature("GevSCPD", "int", address=0xD08, least=0, most=10_000_000, lasting=False),
        Feature("GevHeartbeatTimeout", "int", address=0x938, least=500, most=10000, unit="ms", lasting=False),
        Feature("GevTimestampControlLatch", "command", address=0x944, command=2, age="old"),
        Feature("GevTimestampControlReset", "command", address=0x944, command=1, age="old"),
        Feature("GevTimestampValue", "long", address=0x948, access="RO", age="old"),
        Feature("PtpEnable", "bool", 0, age="new"),
        switch("PtpStatus", *PTP_STATES, access="RO", age="new"),
        Feature("PtpOffsetFromMaster", "long", access="RO", unit="ns", age="new"),
        Feature("GevIEEE1588", "bool", 0, age="old"),
        switch("GevIEEE1588Status", *PTP_STATES, access="RO", age="old"),
    ]


# Old names stand for the new ones: name -> (new name, how many of the old's units are one of the new's).
OLD = {
    "ExposureTimeAbs": ("ExposureTime", 1.0), "AcquisitionFrameRateAbs": ("AcquisitionFrameRate", 1.0),
    "TriggerDelayAbs": ("TriggerDelay", 1.0), "GainRaw": ("Gain", 10.0), "BlackLevelRaw": ("BlackLevel", 1.0),
    "GevIEEE1588": ("PtpEnable", 1.0), "GevIEEE1588Status": ("PtpStatus", 1.0),
}


def lay_out(categories, camera):
    """Drops what this camera has not, gives each feature its address, and returns name -> feature."""
    found, at = {}, BASE
    for category, features in categories.items():
        kept = [each for each in features if each.color in (None, camera.color)]
        for feature in kept:
            feature.category = category
            if feature.address is None and not feature.local and not feature.formula:
                feature.address = at
                at += feature.size() * feature.slots
            found[feature.name] = feature
        features[:] = kept
    return found


# -- GenApi text -----------------------------------------------------------------------------------------------


def _node(kind, name, *lines):
    inner = "\n".join("    " + each for each in lines if each)
    return f'  <{kind} Name="{name}">\n{inner}\n  </{kind}>'


def _tag(name, value):
    return f"<{name}>{escape(str(value))}</{name}>"


def _register(feature, kind):
    per = f'<pIndex Offset="{feature.size()}">{feature.per}Value</pIndex>' if feature.per else ""
    whole = [_tag("Address", f"0x{feature.address:X}"), per, _tag("Length", feature.size()),
             _tag("AccessMode", feature.access), "<pPort>Device</pPort>", "<Cachable>NoCache</Cachable>"]
    if kind == "IntReg":
        whole.append("<Sign>Unsigned</Sign>")
    if kind == "MaskedIntReg":
        low, high = (0, 0) if feature.kind == "command" else (31, 16)  # bit 0 is the highest one
        whole += [_tag("LSB", low), _tag("MSB", high), "<Sign>Unsigned</Sign>"]
    return _node(kind, feature.name + "Reg", *whole, "<Endianess>BigEndian</Endianess>")


def _limits(feature):
    if feature.span:
        least, most = feature.span
        plain = most.replace("_", "").isalnum()
        return [_tag("Min", least), _tag("pMax", most if plain else feature.name + "Most")]
    return [_tag(tag, value) for tag, value in (("Min", feature.least), ("Max", feature.most)) if value is not None]


def _formula(name, formula, known):
    used = [each for each in known if each in formula.replace("(", " ").replace(")", " ").split()]
    return _node("IntSwissKnife", name, *[f'<pVariable Name="{each}">{each}</pVariable>' for each in used],
                 _tag("Formula", formula))


def _feature(feature, known):
    """The nodes of one feature."""
    name, lines, nodes = feature.name, [], []
    if feature.kind == "string":
        return [_node("StringReg", name, _tag("Address", f"0x{feature.address:X}"), _tag("Length", feature.length),
                      _tag("AccessMode", feature.access), "<pPort>Device</pPort>", "<Cachable>NoCache</Cachable>")]
    if feature.formula:
        return [_formula(name + "Value", feature.formula, known),
                _node("Integer", name, _tag("pValue", name + "Value"), _tag("Unit", feature.unit))]
    if feature.still:
        lines.append("<pIsLocked>TLParamsLocked</pIsLocked>")
    if feature.auto:
        nodes.append(_formula(name + "Locked", f"{feature.auto} != 0", [feature.auto]))
        lines.append(_tag("pIsLocked", name + "Locked"))
    if feature.local:
        lines += [_entry(*each) for each in feature.entries.items()]
        selected = [each.name for each in known.values() if each.per == name]
        lines += [_tag("pValue", name + "Value")] + [_tag("pSelected", each) for each in selected]
        return [_node("Enumeration", name, *lines), _node("Integer", name + "Value", _tag("Value", feature.value))]
    masked = feature.name in ("GevSCPSPacketSize", "GevSCPSFireTestPacket")
    nodes.append(_register(feature, "FloatReg" if feature.kind == "float" else "MaskedIntReg" if masked else "IntReg"))
    if feature.kind == "enum":
        lines += [_entry(*each) for each in feature.entries.items()]
    lines.append(_tag("pValue", name + "Reg"))
    if feature.kind == "command":
        lines.append(_tag("CommandValue", feature.command))
    if feature.kind == "bool":
        lines += ["<OnValue>1</OnValue>", "<OffValue>0</OffValue>"]
    if feature.kind in ("int", "long", "float"):
        lines += _limits(feature)
        lines += [_tag("Inc", feature.step)] if feature.step else []
        lines += [_tag("Unit", feature.unit)] if feature.unit else []
        if feature.span and not feature.span[1].isalnum():
            nodes.append(_formula(name + "Most", feature.span[1], known))
    kind = {"int": "Integer", "long": "Integer", "float": "Float", "enum": "Enumeration", "bool": "Boolean",
            "command": "Command"}[feature.kind]
    return [_node(kind, name, *lines), *nodes]


def _entry(name, value):
    return f'<EnumEntry Name="{name}"><Value>{value}</Value></EnumEntry>'


def _chunk_nodes():
    """The features that a chunk parser reads out of a picture."""
    nodes = []
    for name, (number, length) in CHUNKS.items():
        is_float = name in ("ExposureTime", "Gain")
        port = f"Chunk{name}Port"
        nodes.append(_node("Port", port, _tag("ChunkID", f"{number:X}")))
        nodes.append(_node("FloatReg" if is_float else "IntReg", f"Chunk{name}", "<Address>0</Address>",
                           _tag("Length", length), "<AccessMode>RO</AccessMode>", _tag("pPort", port),
                           "" if is_float else "<Sign>Unsigned</Sign>", "<Endianess>BigEndian</Endianess>"))
    return nodes


def text(categories, found, camera):
    """The camera's GenApi text, filled up to a multiple of four bytes."""
    found = {name: each for name, each in found.items() if each.age in ("", camera.names)}
    nodes = [_node("Category", "Root", *[_tag("pFeature", each) for each in categories])]
    for category, features in categories.items():
        shown = [each for each in features if each.name in found]
        chunks = [f"Chunk{each}" for each in CHUNKS] if category == "ChunkDataControl" else []
        nodes.append(_node("Category", category, *[_tag("pFeature", each.name) for each in shown],
                           *[_tag("pFeature", each) for each in chunks]))
        for feature in shown:
            nodes += _feature(feature, found)
    nodes += _chunk_nodes()
    nodes.append(_node("Integer", "TLParamsLocked", "<Value>0</Value>", "<Min>0</Min>", "<Max>1</Max>"))
    nodes.append('  <Port Name="Device"/>')
    # Schema 1.1: registers are read and written as memory. ARV arvgcport.c: before 1.1.0 they are not.
    head = ('<?xml version="1.0" encoding="utf-8"?>\n<RegisterDescription ModelName="{0}" VendorName="{1}" '
            'StandardNameSpace="GEV" SchemaMajorVersion="1" SchemaMinorVersion="1" SchemaSubMinorVersion="0" '
            'MajorVersion="1" MinorVersion="0" SubMinorVersion="0" ToolTip="{0}" '
            'ProductGuid="00000000-0000-0000-0000-000000000001" VersionGuid="00000000-0000-0000-0000-000000000001" '
            'xmlns="http://www.genicam.org/GenApi/Version_1_1">\n').format(escape(camera.model), escape(camera.vendor))
    whole = (head + "\n".join(nodes) + "\n</RegisterDescription>\n").encode()
    return whole + b"\n" * (-len(whole) % 4)
