"""Settings of an excitation and of its blocks."""

from duralab_settings import BlockSettings, ResolvedExcitation


class ExperimentSettings(ResolvedExcitation, BlockSettings):
    """Settings of the excitation of one experiment, and of the blocks of its record; see `ResolvedExcitation`."""

    def samples(self, sample_rate: float) -> int:
        """Return the number of samples of the duration.

        Parameters
        ----------
        sample_rate
            Sample rate in hertz.

        Returns
        -------
        int
            The whole number nearest to duration times rate.
        """
        return round(self.duration * sample_rate)

    def fade_samples(self, sample_rate: float) -> int:
        """Return the number of samples of one fade.

        Parameters
        ----------
        sample_rate
            Sample rate in hertz.

        Returns
        -------
        int
            The whole number nearest to fade times rate.
        """
        return round(self.fade * sample_rate)
