"""The command that writes coupons, parts that are printed to be measured."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.fabricate.coupons import CouponSet
from solen.pipeline.print.coupons import coupons as coupons
from solen.ranks import ranked


@lines.register
def _(result: CouponSet) -> Iterator[str]:
    for coupon in result.coupons:
        if coupon.parts:
            volume = sum(part.volume_mm3 for part in coupon.parts)
            yield f"{coupon.name}: {coupon.features} features, {volume:.5g} mm3"
        else:
            yield f"{coupon.name}: {coupon.title}; {' x '.join(f'{side:.4g}' for side in coupon.size_mm)} mm"
            for reading in coupon.readings:
                yield f'  {reading.about}: published "{reading.printed}"; used: {reading.taken}'
        yield from (f"  {warning}" for warning in ranked(coupon.warnings))
