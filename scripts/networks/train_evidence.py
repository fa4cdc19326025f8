#!/usr/bin/env python3
"""Trains evidence.onnx, the network behind `vision.color_model { network = "evidence.onnx" }`.

train_evidence.py [--out FILE] [--labs N] [--epochs N] [--seed N]: wants Debian's python3-torch, python3-onnx, python3-opencv,
python3-scipy; no part of the build. About half an hour on one core with the defaults.

What it learns: from an image and the evidence F of a color model trained for the robot at hand, what has to be added to F. So the
network knows no robot and no color of its own: it sees what is round a pixel (a body or a vessel of the same color, a rim, a cover).
Scenes are drawn here, by another program than the hard set's (tests/bench/hard_set), with other grounds, bodies and seeds. A "lab" is
one ground and one robot: a color model is counted from six of its undisturbed views, as a person would train it, and judged on eight
others, disturbed. Input: blue, green, red over 255, F over 8, at full size; output: what to add to F, at half size.
"""
import argparse

import cv2
import numpy as np
import torch
from scipy import ndimage
from torch import nn

SIDE = 224  # px of a view
GROUND = 400  # px of a lab's ground
E = 2e-5  # of the color model's decision function
BINS = 32


class EvidenceNet(nn.Module):
    """Three halvings and back, with sums as short cuts: 11 000 weights, 37 Mmac for 320 x 240 px of input."""

    def __init__(self):
        super().__init__()
        self.pool = nn.AvgPool2d(2)

        def block(of, to, **more):
            return nn.Sequential(nn.Conv2d(of, to, 3, padding=more.get("dilation", 1), **more), nn.ReLU())

        self.a = nn.Sequential(block(4, 10, stride=2), block(10, 10))
        self.b = nn.Sequential(block(10, 16, stride=2), block(16, 16))
        self.d = nn.Sequential(block(16, 24, stride=2), block(24, 24), block(24, 24, dilation=2))
        self.up = nn.Upsample(scale_factor=2, mode="nearest")
        self.to_b = nn.Conv2d(24, 16, 1)
        self.b2 = block(16, 16)
        self.to_a = nn.Conv2d(16, 10, 1)
        self.a2 = block(10, 10)
        self.to_p = nn.Conv2d(10, 4, 1)
        self.last = nn.Sequential(block(8, 4), nn.Conv2d(4, 1, 1))

    def forward(self, x):
        p = self.pool(x)
        a = self.a(p)
        b = self.b(a)
        d = self.d(b)
        b = self.b2(torch.relu(self.to_b(self.up(d)) + b))
        a = self.a2(torch.relu(self.to_a(self.up(b)) + a))
        return self.last(torch.cat([self.up(self.to_p(a)), p], 1))


def noise_field(rng, pitch, side):
    n = side // pitch + 4
    return cv2.resize(rng.standard_normal((n, n)).astype(np.float32), (side, side), interpolation=cv2.INTER_CUBIC)


def line_walk(rng, share, at, heading, width, bend):
    while width > 1.5 and -50 < at[0] < GROUND + 50 and -50 < at[1] < GROUND + 50:
        heading += rng.normal(0, bend)
        to = at + 9 * np.array([np.cos(heading), np.sin(heading)])
        cv2.line(share, tuple(int(x * 8) for x in at), tuple(int(x * 8) for x in to), 1.0, max(1, round(width)), cv2.LINE_AA, 3)
        at, width = to, width * rng.uniform(0.97, 1.0)
        if rng.random() < 0.05 and width > 3:
            line_walk(rng, share, at, heading + rng.choice([-1, 1]) * rng.uniform(0.4, 1.1), 0.7 * width, bend)


def ground_of(rng, robot_color):
    """CV BGR floats. Tissue, or any color; noise, stripes, vessels and patches, some of the robot's own color."""
    base = np.array([48, 84, 156]) * rng.uniform(0.6, 1.4, 3) if rng.random() < 0.6 else rng.uniform(25, 200, 3)
    light = np.ones((GROUND, GROUND, 3), np.float32) * base.astype(np.float32)
    strong = rng.uniform(0.5, 3) if rng.random() < 0.7 else rng.uniform(3, 9)
    for pitch in (rng.integers(60, 130), rng.integers(20, 50), rng.integers(5, 15)):
        light += strong * noise_field(rng, int(pitch), GROUND)[..., None] * rng.uniform(1, 6, 3).astype(np.float32)
    if rng.random() < 0.25:  # hair, fibers
        kernel = np.zeros((31, 31), np.float32)
        angle = rng.uniform(0, np.pi)
        cv2.line(kernel, (15 - int(14 * np.cos(angle)), 15 - int(14 * np.sin(angle))),
                 (15 + int(14 * np.cos(angle)), 15 + int(14 * np.sin(angle))), 1 / 29)
        fibers = cv2.filter2D(noise_field(rng, int(rng.integers(2, 5)), GROUND), -1, kernel)
        light *= 1 + rng.uniform(0.2, 0.9) * fibers[..., None]
    for _ in range(rng.integers(0, 4)):  # vessels, in up to three colors
        share = np.zeros((GROUND, GROUND), np.float32)
        for _ in range(rng.integers(2, 9)):
            line_walk(rng, share, rng.uniform(0, GROUND, 2), rng.uniform(0, 6.28), rng.uniform(3, 17), rng.uniform(0.03, 0.2))
        share = cv2.GaussianBlur(share, (0, 0), rng.uniform(0.8, 2.5))[..., None]
        if rng.random() < 0.5:
            color = robot_color * rng.normal(1, 0.12, 3)
            light = light * (1 - share) + share * color.astype(np.float32)
        else:
            light *= 1 - share * (1 - rng.uniform(0.3, 1.05, 3).astype(np.float32))
    for _ in range(rng.integers(0, 12) if rng.random() < 0.5 else 0):  # patches: bleeding, exudate, the optic disc
        share = np.zeros((GROUND, GROUND), np.float32)
        size = rng.uniform(5, 60, 2)
        cv2.ellipse(share, (tuple(rng.uniform(0, GROUND, 2)), tuple(2 * size), rng.uniform(0, 180)), rng.uniform(0.4, 1), -1, cv2.LINE_AA)
        share = cv2.GaussianBlur(share, (0, 0), rng.uniform(1, 4))[..., None]
        light *= 1 - share * (1 - rng.uniform(0.4, 1.5, 3).astype(np.float32))
    return np.clip(light, 2, 250)


class Lab:
    def __init__(self, rng):
        self.rng = rng
        gray = rng.uniform(35, 150)
        self.color = gray * rng.normal(1, 0.05, 3) if rng.random() < 0.7 else rng.uniform(20, 220, 3)
        self.ground = ground_of(rng, self.color)
        major = np.exp(rng.uniform(np.log(11), np.log(46)))
        self.axes = np.array([major, major * rng.uniform(0.4, 0.95)])
        self.corners = rng.random() < 0.2  # no ellipse: a bar
        self.shading = rng.uniform(0, 0.6)
        self.reflex = rng.uniform(0, 100) if rng.random() < 0.6 else 0
        self.spot = rng.uniform(-0.5, 0.5, 2)
        self.shadow = rng.uniform(0, 0.3)
        self.blur = rng.uniform(0.7, 1.6)
        self.noise = rng.uniform(1, 4)

    def view(self, hard):
        """(image uint8, mask as shares 0 to 1)."""
        rng = self.rng
        u0, v0 = rng.integers(0, GROUND - SIDE, 2)
        light = self.ground[v0:v0 + SIDE, u0:u0 + SIDE].copy()
        if rng.random() < 0.5:
            light = light[:, ::-1].copy()
        mask = np.zeros((SIDE, SIDE), np.float32)
        if not (hard and rng.random() < 0.12):
            light, mask = self.with_robot(light, hard)
        if hard and rng.random() < 0.25:
            light, mask = self.covered(light, mask)
        light *= 1 + (rng.uniform(-0.25, 0.25) if hard else rng.uniform(-0.03, 0.03))
        if hard and rng.random() < 0.3:  # slope of light, a cast
            x = np.linspace(-1, 1, SIDE, dtype=np.float32)
            light *= (1 + rng.uniform(-0.35, 0.35) * x[None, :] + rng.uniform(-0.35, 0.35) * x[:, None])[..., None]
            light *= rng.uniform(0.9, 1.1, 3).astype(np.float32)
        blur = self.blur if not hard or rng.random() < 0.7 else rng.uniform(1.5, 6)
        light = cv2.GaussianBlur(light, (0, 0), blur)
        noise = self.noise if not hard or rng.random() < 0.7 else rng.uniform(4, 9)
        light += ndimage.uniform_filter(rng.standard_normal(light.shape), (2, 2, 1)) * 1.6 * noise
        image = np.clip(light, 0, 255).astype(np.uint8)
        if hard and rng.random() < 0.25:
            image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(12, 70))])[1], 1)
        return image, mask

    def with_robot(self, light, hard):
        rng = self.rng
        axes = self.axes * (np.exp(rng.uniform(-0.4, 0.4)) if hard and rng.random() < 0.3 else 1)
        center = rng.uniform(20, SIDE - 20, 2)
        angle = rng.uniform(0, np.pi)
        v, u = np.mgrid[0:SIDE, 0:SIDE].astype(np.float32)
        c, s = np.cos(angle), np.sin(angle)

        def radius(at, grow):
            x = (c * (u - at[0]) + s * (v - at[1])) / (axes[0] + grow)
            y = (c * (v - at[1]) - s * (u - at[0])) / (axes[1] + grow)
            return (x, y, np.maximum(abs(x), abs(y)) if self.corners else np.hypot(x, y))

        x, y, r = radius(center, 0)
        share = np.clip(0.5 + (1 - r) * axes[1], 0, 1)
        body = self.color.astype(np.float32) * (1 - self.shading * np.clip(r, 0, 1) ** 2)[..., None]
        body = body + self.reflex * np.exp(-((x - self.spot[0]) ** 2 + (y - self.spot[1]) ** 2) / 0.02)[..., None]
        beside = radius(center + rng.uniform(-5, 5, 2), 3)[2]
        light = light * (1 - self.shadow * np.clip(4 * (1 - beside), 0, 1))[..., None]
        return light * (1 - share[..., None]) + share[..., None] * body, share.astype(np.float32)

    def covered(self, light, mask):
        """A tool, a blot of another color over it, or a reflex."""
        rng = self.rng
        share = np.zeros((SIDE, SIDE), np.float32)
        at = rng.uniform(0, SIDE, 2)
        if rng.random() < 0.4:
            v, u = np.mgrid[0:SIDE, 0:SIDE]
            spot = np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * rng.uniform(5, 16) ** 2))[..., None]
            return light + 400 * spot.astype(np.float32), mask * (spot[..., 0] < 0.3)
        angle = rng.uniform(0, 6.28)
        cv2.line(share, tuple(int(x) for x in at), tuple(int(x) for x in at + 400 * np.array([np.cos(angle), np.sin(angle)])), 1.0,
                 int(rng.integers(8, 60)), cv2.LINE_AA)
        color = self.color * rng.normal(1, 0.1, 3) if rng.random() < 0.4 else rng.uniform(20, 220, 3)
        return light * (1 - share[..., None]) + share[..., None] * color.astype(np.float32), mask * (1 - share)


def histogram(pixels):
    cells = (pixels >> 3).astype(np.int64)
    counts = np.bincount(cells[:, 0] * BINS * BINS + cells[:, 1] * BINS + cells[:, 2], minlength=BINS ** 3)
    counts = ndimage.gaussian_filter(counts.reshape(BINS, BINS, BINS).astype(np.float64), 0.6)
    return counts / max(counts.sum(), 1)


def evidence_table(views):
    """F of 32^3 cells, as ColorModel::train counts it."""
    on = np.concatenate([image[mask > 0.5] for image, mask in views])
    off = np.concatenate([image[mask < 0.5] for image, mask in views])
    return np.clip(np.log((histogram(on) + E) / (histogram(off) + E)), -7.9, 7.9).astype(np.float32)


def samples_of(seed, labs):
    """(B, G, R, 16 F + 128) as bytes, and masks as bytes."""
    images, masks = [], []
    for k in range(labs):
        lab = Lab(np.random.default_rng([seed, k]))
        views = [lab.view(False) for _ in range(6)]
        if any(mask.max() < 0.5 for _, mask in views):
            continue
        table = evidence_table(views)
        for _ in range(8):
            image, mask = lab.view(True)
            gain = np.exp(lab.rng.normal(0, 0.08))  # the light, as the tracker has learnt it, is off by some percent
            image = np.clip(image * gain, 0, 255).astype(np.uint8)
            cell = image >> 3
            f = table[cell[..., 0], cell[..., 1], cell[..., 2]]
            images.append(np.concatenate([image, np.clip(f * 16 + 128, 0, 255).astype(np.uint8)[..., None]], 2).transpose(2, 0, 1))
            masks.append((255 * mask).astype(np.uint8))
        if k % 50 == 49:
            print(f"{k + 1} labs drawn", flush=True)
    return torch.from_numpy(np.stack(images)), torch.from_numpy(np.stack(masks))


def inputs_of(bytes_):
    x = bytes_.float()
    return torch.cat([x[:, :3] / 255, (x[:, 3:] - 128) / 128], 1)


def total_of(net, x):
    """F and what is added to it, of the 3 x 3 mean that the tracker reads."""
    more = nn.functional.interpolate(net(x), scale_factor=2, mode="bilinear", align_corners=False)
    f = nn.functional.avg_pool2d(8 * x[:, 3:] + more, 3, 1, 1)
    return f.clamp(-7.9, 7.9)[:, 0]


def loss_of(f, mask):
    """Each class weighs the same, so that F stays a log-likelihood ratio; the ground near the body weighs three times."""
    near = nn.functional.max_pool2d((mask > 0.5).float()[:, None], 25, 1, 12)[:, 0]
    loss = nn.functional.binary_cross_entropy_with_logits(f, mask, reduction="none")
    ground = (1 - mask) * (1 + 2 * near)
    return (loss * mask).sum() / mask.sum().clamp(min=1) + (loss * ground).sum() / ground.sum()


def wrong_shares(f, mask):
    on, off = mask > 0.5, mask < 0.5
    return (f[on] < 0).float().mean().item(), (f[off] > 0).float().mean().item()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", default="evidence.onnx")
    parser.add_argument("--labs", type=int, default=400)
    parser.add_argument("--epochs", type=int, default=12)
    parser.add_argument("--seed", type=int, default=71)
    args = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    torch.manual_seed(args.seed)
    x, y = samples_of(args.seed, args.labs)
    tx, ty = samples_of(args.seed + 1, max(args.labs // 12, 4))
    net = EvidenceNet()
    nn.init.zeros_(net.last[1].weight)  # from the start: F as the colors have it
    nn.init.zeros_(net.last[1].bias)
    print(sum(p.numel() for p in net.parameters()), "weights,", len(x), "views")
    adam = torch.optim.Adam(net.parameters(), 3e-3)
    steps = args.epochs * (len(x) // 16)
    schedule = torch.optim.lr_scheduler.OneCycleLR(adam, 6e-3, total_steps=steps)
    for epoch in range(args.epochs):
        net.train()
        order = torch.randperm(len(x))
        sum_ = 0.0
        for k in range(len(x) // 16):
            pick = order[16 * k:16 * k + 16]
            loss = loss_of(total_of(net, inputs_of(x[pick])), y[pick].float() / 255)
            adam.zero_grad()
            loss.backward()
            adam.step()
            schedule.step()
            sum_ += loss.item()
        net.eval()
        with torch.no_grad():
            inputs, mask = inputs_of(tx), ty.float() / 255
            f = torch.cat([total_of(net, inputs[k:k + 16]) for k in range(0, len(tx), 16)])
            color = nn.functional.avg_pool2d(8 * inputs[:, 3:], 3, 1, 1)[:, 0]
            print(f"epoch {epoch + 1}: loss {sum_ / (len(x) // 16):.4f}, of other labs {loss_of(f, mask):.4f} "
                  f"(colors {loss_of(color, mask):.4f}); missed, false {wrong_shares(f, mask)} (colors {wrong_shares(color, mask)})",
                  flush=True)
        torch.onnx.export(net, torch.zeros(1, 4, SIDE, SIDE), args.out, opset_version=11, input_names=["image"],
                          output_names=["more"], dynamic_axes={"image": {2: "v", 3: "u"}, "more": {2: "v", 3: "u"}})


if __name__ == "__main__":
    main()
